"""The description of an observation against observations themselves."""

import numpy as np
import pytest

from tests.env.races import RING, race_env, random_race


@pytest.mark.parametrize("drones", [1, 3])
@pytest.mark.parametrize("kind", ["extended", "paper", "body", "body-near"])
def test_sizes_and_bounds(kind, drones):
    env = race_env(drones)
    state = random_race(env, out=0.3 if drones > 1 else 0.0)
    seen = np.asarray(env.observe_as[kind](state))
    entries = env.layout(kind)
    assert sum(entry.size for entry in entries) == seen.shape[0]
    first = 0
    for entry in entries:
        part = seen[first : first + entry.size]
        assert part.min() >= entry.low, entry.name
        assert part.max() <= entry.high, entry.name
        first += entry.size
    assert len({entry.name for entry in entries}) == len(entries)


def test_quantities_over_their_scales():
    """Entries that can be computed in a line, for a state far from every clip."""
    env = race_env(2)
    state = random_race(env, spread=3.0, speed=2.0, out=0.0)
    gates = np.array([gate.position_w for gate in RING.gates])[np.asarray(state.next_gate)]  # [N, E, 3]
    position, velocity = (np.moveaxis(np.asarray(v), 0, 2) for v in (state.drones.position_w, state.drones.velocity_w))
    distance = np.linalg.norm(gates - position, axis=2)
    other = position[::-1] - position
    apart = np.linalg.norm(other, axis=2, keepdims=True)
    expected = {
        "paper": {
            "to_gate": gates - position,
            "distance": distance[..., None],
            "velocity": velocity,
            "closing_speed": ((gates - position) * velocity).sum(axis=2, keepdims=True) / distance[..., None],
            "position": position,
            "opponent_1_offset": other,
        },
        "extended": {
            "distance": distance[..., None],
            "closing_speed": ((gates - position) * velocity).sum(axis=2, keepdims=True) / distance[..., None],
            "height": position[..., 2:],
            "opponent_1_closeness": np.exp(-apart) * np.clip(2 - apart / 2.5, 0, 1),
        },
        "body": {"height": position[..., 2:]},
    }
    for kind, quantities in expected.items():
        seen, first = np.asarray(env.observe_as[kind](state)), 0
        for entry in env.layout(kind):
            if entry.name in quantities:
                scaled = np.clip(quantities[entry.name] / entry.scale, entry.low, entry.high)
                part = np.moveaxis(seen[first : first + entry.size], 0, 2)
                np.testing.assert_allclose(part, scaled, atol=1e-4, err_msg=entry.name)
            first += entry.size
