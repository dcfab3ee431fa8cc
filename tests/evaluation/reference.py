"""What happened in a race and what is measured of it, again: plain NumPy, written from `docs/race-log.md`.

It uses positions, attitudes, the track and the number of the first gate from the file, and none of its events.
"""

import itertools

import numpy as np

MISS_REACH = 5.0
FLIP = np.pi / 2
SHARES = np.linspace(0.0, 1.0, 4001)  # of a step


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
        met = {drone: list(alone(log, k, drone)) for drone in np.flatnonzero(flying)}
        met = {drone: [(kind, share, gate, -1) for kind, share, gate in hits] for drone, hits in met.items()}
        for drone, share, other in meetings(log, start, end, flying):
            met[drone].append(("drone", share, -1, other))
        for drone, hits in met.items():
            crash = min((share for _, share, *_ in hits), default=2.0)
            gate = target[drone]
            ahead, _, share, beyond = plane(log, gate, start[drone], end[drone])
            time, finished = (k + share) * log["control_dt"], False
            if ahead and share <= crash and beyond <= 0:
                events.append(("crossing", drone, time, gate, -1))
                target[drone] = (gate + 1) % gates
                passed[drone] += 1
                finished = passed[drone] == log["laps"] * gates + 1
                if finished:
                    events.append(("finish", drone, time, gate, -1))
            elif ahead and share <= crash and log["frame_width"] < beyond <= MISS_REACH:
                events.append(("missed_gate", drone, time, gate, -1))
            if not finished:
                first = [hit for hit in hits if hit[1] <= crash + 1e-9]
                events += [(f"collision_{a}", drone, (k + b) * log["control_dt"], c, d) for a, b, c, d in first]
            flying[drone] &= not (finished or hits)
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
    struck = []
    for gate in range(len(log["gate_yaw"])):
        ahead, back, share, beyond = plane(log, gate, start, end)
        if (ahead or back) and 0 < beyond <= log["frame_width"]:
            struck.append((share, gate))
    if struck:
        yield "gate_frame", *min(struck)
    points = start + SHARES[:, None] * (end - start)
    low, high = log["bounds"]
    if end[2] <= 0:
        yield "ground", SHARES[(points[:, 2] <= 0).argmax()], -1
    outside = (points > high).any(axis=1) | (points < low)[:, :2].any(axis=1)
    if outside[-1]:
        yield "bounds", SHARES[outside.argmax()], -1
    elif np.linalg.norm(log["gate_position"] - end, axis=1).min() > log["leave_distance"]:
        yield "bounds", 1.0, -1
    for kind in ("pole", "wall"):
        inside = np.any([within(log, solid, points) for solid in np.flatnonzero(log["solid_kind"] == kind)], axis=0)
        if np.any(inside):
            yield kind, SHARES[inside.argmax()], -1
    if (np.abs(log["euler"][k + 1, drone, :2]) > FLIP).any():
        yield "flip", 1.0, -1


def within(log, solid, points):
    """Which points lie in a solid."""
    yaw, half = log["solid_yaw"][solid], log["solid_size"][solid] / 2
    x, y, z = (points - log["solid_position"][solid]).T
    along, across = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
    level = np.hypot(x, y) <= half[0] if log["solid_shape"][solid] == "cylinder" else np.abs(across) <= half[1]
    return level & (np.abs(along) <= half[0]) & (np.abs(z) <= half[2])


def meetings(log, start, end, flying):
    """Drones that come too near another: share of the step at which they do, and the nearest other. By sampling."""
    for drone in np.flatnonzero(flying):
        nearest = {}
        for other in np.flatnonzero(flying):
            if other != drone:
                gap = start[other] - start[drone]
                motion = (end[other] - end[drone]) - gap
                nearest[other] = np.linalg.norm(gap + SHARES[:, None] * motion, axis=1)
        if not nearest:
            continue
        other = min(nearest, key=lambda o: nearest[o].min())
        near = nearest[other] < log["collision_distance"]
        if near.any():
            yield drone, SHARES[near.argmax()], other


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
