"""The paper's reward and observation again, in plain float64 NumPy, sharing no line with the package."""

import numpy as np

from cruise.config import Track

D_MAX = V_MAX = 10.0


def r_prox(distance: float, a: float = 2.0) -> float:
    x = distance / D_MAX
    return 2 * (np.exp(-a * x) - np.exp(-a)) / (1 - np.exp(-a)) - 1


def r_prog(before: float, after: float, beta: float = 2.5) -> float:
    return beta * (before - after)


def r_align(position: np.ndarray, velocity: np.ndarray, gate: np.ndarray) -> float:
    if np.linalg.norm(velocity) <= 1e-6:
        return 0.0
    u = (gate - position) / np.linalg.norm(gate - position)
    return 1 - velocity @ u / (np.linalg.norm(velocity) * np.linalg.norm(u))


def r_speed(velocity: np.ndarray, v_min: float) -> float:
    speed = np.linalg.norm(velocity)
    return speed - v_min if speed <= v_min else v_min - speed


def projection(position: np.ndarray, velocity: np.ndarray, other: np.ndarray) -> float:
    """Of j's position relative to i on i's heading."""
    speed = np.linalg.norm(velocity)
    return 0.0 if speed == 0 else (other - position) @ velocity / speed


def r_over(i: int, before: dict, after: dict, flying: np.ndarray, sign: str, reach: float) -> int:
    """Opponents whose projection changed sign, as printed (negative to positive) or the other way round."""
    count = 0
    for j in range(flying.size):
        if j == i or not (flying[i] and flying[j]):
            continue
        if np.linalg.norm(after["p"][:, j] - after["p"][:, i]) >= reach:
            continue
        old = projection(before["p"][:, i], before["v"][:, i], before["p"][:, j])
        new = projection(after["p"][:, i], after["v"][:, i], after["p"][:, j])
        count += (old < 0 < new) if sign == "paper" else (old > 0 > new)
    return count


def r_coll(i: int, positions: np.ndarray, flying: np.ndarray, delta: float) -> bool:
    """As printed: at the end of the step alone."""
    return any(
        flying[i] and flying[j] and np.linalg.norm(positions[:, i] - positions[:, j]) < delta
        for j in range(flying.size)
        if j != i
    )


def observation(track: Track, i: int, race: dict[str, np.ndarray]) -> np.ndarray:
    """o_{t,i} in the order of the paper's equation. `race` holds p, v, euler [3, N], target and flying [N].

    Opponents in the order i + 1, i + 2, ... modulo N; one that is out is at no offset and full distance.
    """
    p, v, target = race["p"][:, i], race["v"][:, i], int(race["target"][i])
    gate = np.array(track.gates[target].position_w)
    distance = np.linalg.norm(gate - p)
    one_hot = np.zeros(len(track.gates))
    one_hot[target] = 1.0
    turn = race["euler"][2, i] - track.gates[target].yaw
    own = [*(gate - p) / D_MAX, distance / D_MAX, *v / V_MAX, v @ (gate - p) / distance / V_MAX]
    own += [*one_hot, *p / D_MAX, np.sin(turn), np.cos(turn)]
    drones = race["flying"].size
    offsets, distances = [], []
    for j in ((i + k) % drones for k in range(1, drones)):
        offset = race["p"][:, j] - p if race["flying"][j] else np.zeros(3)
        offsets += [*offset / D_MAX]
        distances.append(np.linalg.norm(offset) / D_MAX if race["flying"][j] else 1.0)
    return np.clip([*own, *offsets, *distances], -1, 1)
