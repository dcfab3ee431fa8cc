"""What happened in a race and what is measured of it, again: plain NumPy, written from `docs/race-log.md`.

It uses positions, attitudes, the track and the number of the first gate from the file, and none of its events.
"""

import itertools

import numpy as np

MISS_REACH = 5.0
FLIP = np.pi / 2


def read(path):
    """The arrays of a race log."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def replay(log):
    """Events (kind, drone, time, gate, other), and who is airborne at every sample, step by step."""
    samples, drones, _ = log["position_w"].shape
    position = log["position_w"].astype(np.float64)
    gates = len(log["gate_yaw"])
    target = log["next_gate"][0].copy()
    passed = np.zeros(drones, int)
    flying = np.ones(drones, bool)
    airborne, events = [flying.copy()], []
    for k in range(samples - 1):
        start, end = position[k], position[k + 1]
        out, done = set(), set()
        for drone in np.flatnonzero(flying):
            gate = target[drone]
            ahead, _, share, beyond = plane(log, gate, start[drone], end[drone])
            time = (k + share) * log["control_dt"]
            if ahead and beyond <= 0:
                events.append(("crossing", drone, time, gate, -1))
                target[drone] = (gate + 1) % gates
                passed[drone] += 1
                if passed[drone] == log["laps"] * gates + 1:
                    done.add((drone, time, gate))
            elif ahead and log["frame_width"] < beyond <= MISS_REACH:
                events.append(("missed_gate", drone, time, gate, -1))
            for kind, share, struck in alone(log, k, drone):
                events.append((f"collision_{kind}", drone, (k + share) * log["control_dt"], struck, -1))
                out.add(drone)
        for drone, share, other in meetings(log, start, end, flying):
            events.append(("collision_drone", drone, (k + share) * log["control_dt"], -1, other))
            out.add(drone)
        for drone, time, gate in done:
            if drone not in out:
                events.append(("finish", drone, time, gate, -1))
        for drone in out | {drone for drone, *_ in done}:
            flying[drone] = False
        airborne.append(flying.copy())
    return events, np.array(airborne)


def plane(log, gate, start, end):
    """Crosses the gate's plane ahead, or back; at which share of the segment; how far beyond the opening's edge."""
    yaw, centre = log["gate_yaw"][gate], log["gate_position"][gate]
    normal = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    before, after = (start - centre) @ normal, (end - centre) @ normal
    if before == after:
        return False, False, 0.0, np.inf
    share = before / (before - after)
    at = start + share * (end - start) - centre
    sideways = abs(at @ np.array([-np.sin(yaw), np.cos(yaw), 0.0]))
    width, height = log["gate_size"][gate]
    return before < 0 <= after, after < 0 <= before, share, max(sideways - width / 2, abs(at[2]) - height / 2)


def alone(log, k, drone):
    """Collisions of a drone with the world in step k: kind, share of the step, gate."""
    start, end = log["position_w"][k : k + 2, drone].astype(np.float64)
    for gate in range(len(log["gate_yaw"])):
        ahead, back, share, beyond = plane(log, gate, start, end)
        if (ahead or back) and 0 < beyond <= log["frame_width"]:
            yield "gate_frame", share, gate
    if end[2] <= 0:
        yield "ground", 1.0, -1
    low, high = log["bounds"]
    nearest = np.linalg.norm(log["gate_position"] - end, axis=1).min()
    if (end > high).any() or (end < low)[:2].any() or nearest > log["leave_distance"]:
        yield "bounds", 1.0, -1
    if (np.abs(log["euler"][k + 1, drone, :2]) > FLIP).any():
        yield "flip", 1.0, -1


def meetings(log, start, end, flying):
    """Drones that come too near another: share of the step at which they do, and the nearest other. By sampling."""
    shares = np.linspace(0.0, 1.0, 4001)
    for drone in np.flatnonzero(flying):
        nearest = {}
        for other in np.flatnonzero(flying):
            if other != drone:
                gap = start[other] - start[drone]
                motion = (end[other] - end[drone]) - gap
                nearest[other] = np.linalg.norm(gap + shares[:, None] * motion, axis=1)
        if not nearest:
            continue
        other = min(nearest, key=lambda o: nearest[o].min())
        near = nearest[other] < log["collision_distance"]
        if near.any():
            yield drone, shares[near.argmax()], other


def measure(log):
    """The race in numbers."""
    events, airborne = replay(log)
    gates, drones = len(log["gate_yaw"]), airborne.shape[1]
    times = [sorted(t for kind, d, t, *_ in events if kind == "crossing" and d == drone) for drone in range(drones)]
    finish = {d: t for kind, d, t, *_ in events if kind == "finish"}
    corners = log["gate_position"]
    speed = np.linalg.norm(log["velocity_w"].astype(np.float64), axis=2)
    collisions = {}
    for kind, d, t, _, other in events:
        if kind.startswith("collision_"):
            who = (min(d, other), max(d, other)) if kind == "collision_drone" else (d, t)
            collisions.setdefault(kind, set()).add(who)
    return {
        "events": events,
        "airborne": airborne,
        "finished": [drone in finish for drone in range(drones)],
        "finish_time": [finish.get(drone, np.nan) for drone in range(drones)],
        "first_lap": [t[gates] if len(t) > gates else np.nan for t in times],
        "flying_laps": [[t[k + gates] - t[k] for k in range(gates, len(t) - gates, gates)] for t in times],
        "mean_speed": [speed[airborne[:, d], d].mean() for d in range(drones)],
        "top_speed": [speed[airborne[:, d], d].max() for d in range(drones)],
        "missed": sum(kind == "missed_gate" for kind, *_ in events),
        "collisions": {kind: len(who) for kind, who in collisions.items()},
        "overtakes": overtakes(times),
        "winner": min(finish, key=finish.get, default=-1),
        "lap_length": np.linalg.norm(np.diff(corners, axis=0, append=corners[:1]), axis=1).sum(),
    }


def overtakes(times):
    """Pairs that change order between two successive crossings that both make."""
    count = 0
    for a, b in itertools.combinations(times, 2):
        for c in range(min(len(a), len(b)) - 1):
            count += (a[c] - b[c]) * (a[c + 1] - b[c + 1]) < 0
    return count
