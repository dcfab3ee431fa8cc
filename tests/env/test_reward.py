"""Each component of the reward against an independent transcription, on random steps of random races."""

import functools
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import RewardWeights
from cruise.env.payment import make_reward
from cruise.presets import CURRICULUM, REWARDS
from tests.env import paper_reference as paper
from tests.env.races import RING, rules_of
from tests.env.steps import crossing_of, step_of

DRONES, RACES = 4, 60
STAGE = CURRICULUM[-1]
GATES = np.array([g.position_w for g in RING.gates])
YAWS = np.array([g.yaw for g in RING.gates])


def random_step(seed: int = 0, at_gate: bool = False) -> dict[str, np.ndarray]:
    """A step that never flew: before and after are unrelated, so that every sign occurs. [3, N, E] and [N, E].

    It begins near one gate, whichever the target is, or near the target.
    """
    rng = np.random.default_rng(seed)
    shape = (3, DRONES, RACES)
    gate = rng.integers(5, size=shape[1:])
    around = GATES[gate].transpose(2, 0, 1) if at_gate else np.array([8.0, 0, 4.0])[:, None, None]
    p0 = rng.uniform(-2, 2, shape) + around
    v0, v1 = (rng.normal(size=shape) * rng.choice([0.0, 1.0, 6.0], shape[1:]) for _ in range(2))
    return {
        "p0": p0,
        "p1": p0 + rng.normal(size=shape) * rng.choice([0.05, 0.5, 2.0], shape[1:]),
        "v0": v0,
        "v1": v1,
        "gate": GATES[gate].transpose(2, 0, 1),
        "normal": np.stack([np.cos(YAWS[gate]), np.sin(YAWS[gate])]),
        "flying": rng.random(shape[1:]) < 0.8,
        "collided": rng.random(shape[1:]) < 0.3,
        "nearest": np.where(rng.random(shape[1:]) < 0.2, np.inf, rng.uniform(0.1, 3, shape[1:])),
    }


def components_of(weights: RewardWeights, step: dict[str, np.ndarray], rules: object = None) -> dict[str, np.ndarray]:
    """Weighted components by the package."""

    def compute(s: dict[str, jax.Array], rules: object) -> dict[str, jax.Array]:
        return make_reward(weights).components(step_of(s, rules))

    arrays = {k: jnp.asarray(v, bool if v.dtype == bool else jnp.float32) for k, v in step.items()}
    return {k: np.asarray(v) for k, v in jax.jit(compute)(arrays, rules_of(STAGE) if rules is None else rules).items()}


def each_drone(step: dict[str, np.ndarray], formula: object) -> np.ndarray:
    """`formula(race, drone)` for all, [N, E]; a race is the step with its last axis picked."""
    races = [{k: v[..., e] for k, v in step.items()} for e in range(RACES)]
    return np.array([[formula(race, i) for race in races] for i in range(DRONES)])


def to_go(w: RewardWeights, s: dict[str, np.ndarray], i: int, point: str) -> float:
    """Distance of drone i to its gate: to the centre, or to the nearest point of the opening less its margin."""
    offset = s[point][:, i] - s["gate"][:, i]
    if w.progress_to == "opening":
        forward = np.append(s["normal"][:, i], 0.0)
        left, half = np.cross([0, 0, 1], forward), 1.0 - w.edge_margin
        nearest = np.clip(offset @ left, -half, half) * left + np.array([0, 0, np.clip(offset[2], -half, half)])
        offset = offset - nearest
    return float(np.linalg.norm(offset))


def speed_paid(w: RewardWeights, velocity: np.ndarray) -> float:
    """As printed, or as much more as makes it nothing at rest."""
    at_rest = paper.r_speed(np.zeros(3), STAGE.v_min)
    return paper.r_speed(velocity, STAGE.v_min) - (at_rest if w.speed_zero_at == "rest" else 0.0)


def lacks_room(w: RewardWeights, s: dict[str, np.ndarray], i: int) -> float:
    """How much nearer than its margin a step goes by the frame of a gate of 2 m, in either direction."""
    forward = np.append(s["normal"][:, i], 0.0)
    left = np.cross([0, 0, 1], forward)
    before, after = (s[point][:, i] - s["gate"][:, i] for point in ("p0", "p1"))
    if (before @ forward < 0) == (after @ forward < 0):
        return 0.0
    there = before + (after - before) * (before @ forward) / ((before - after) @ forward)
    beyond = max(abs(there @ left), abs(there[2])) - 1.0
    return float(np.clip(w.beside_margin - (beyond - 0.3), 0.0, w.beside_margin)) if beyond > 0 else 0.0


FORMULAS = {
    "beside": lambda w, s, i: -w.w_beside * 2 * lacks_room(w, s, i),  # the gate before the target is the same gate
    "prox": lambda w, s, i: w.w_prox * paper.r_prox(to_go(w, s, i, "p1"), w.proximity_decay),
    "prog": lambda w, s, i: w.w_prog * paper.r_prog(to_go(w, s, i, "p0"), to_go(w, s, i, "p1"), w.progress_scale),
    "align": lambda w, s, i: -w.w_align * paper.r_align(s["p1"][:, i], s["v1"][:, i], s["gate"][:, i]),
    "speed": lambda w, s, i: w.w_speed * speed_paid(w, s["v1"][:, i]),
}
WEIGHTS = {**REWARDS, "opening": replace(REWARDS["paper"], progress_to="opening")}
WEIGHTS["alone"] = replace(REWARDS["agile"], w_beside=15.0)


@pytest.mark.parametrize("preset", WEIGHTS)
@pytest.mark.parametrize("name", FORMULAS)
def test_flight_terms_are_the_papers(name: str, preset: str) -> None:
    weights, step = replace(WEIGHTS[preset], pay_up_to_v_min=False), random_step(1, at_gate=name == "beside")
    expected = each_drone(step, lambda s, i: FORMULAS[name](weights, s, i))
    np.testing.assert_allclose(components_of(weights, step)[name], expected, atol=2e-5)
    if preset == ("alone" if name == "beside" else "paper"):
        assert np.ptp(expected) > 0.1


@pytest.mark.parametrize("reach", [4.0, np.inf])
@pytest.mark.parametrize("sign", ["fixed", "paper"])
def test_overtaking_with_either_sign(sign: str, reach: float) -> None:
    """Fixed: j goes from ahead to behind. Paper: as printed, from behind to ahead."""
    step = random_step(2)
    weights = RewardWeights(overtake_sign=sign, overtake_range=reach)

    def count(s: dict[str, np.ndarray], i: int) -> int:
        before, after = {"p": s["p0"], "v": s["v0"]}, {"p": s["p1"], "v": s["v1"]}
        return paper.r_over(i, before, after, s["flying"], sign, reach)

    expected = STAGE.w_over * each_drone(step, count)
    assert (expected > 0).mean() > 0.05
    np.testing.assert_allclose(components_of(weights, step)["over"], expected, atol=1e-6)


def test_overtaking_and_being_overtaken_are_opposites() -> None:
    """Drone 0 flies past drone 1: with the fixed sign 0 is rewarded, with the paper's 1 is."""
    p0 = np.array([[[0.0], [0.5]], [[0.0], [0.8]], [[3.0], [3.0]]])
    p1 = p0 + np.array([[[1.0], [0.2]], [[0.0], [0.0]], [[0.0], [0.0]]])
    v = np.array([[[10.0], [2.0]], [[0.0], [0.0]], [[0.0], [0.0]]])
    step = {"p0": p0, "p1": p1, "v0": v, "v1": v, "gate": p0 + 9.0, "normal": np.zeros((2, 2, 1))}
    step |= {"flying": np.ones((2, 1), bool), "collided": np.zeros((2, 1), bool), "nearest": np.full((2, 1), 5.0)}
    for sign, winner in (("fixed", 0), ("paper", 1)):
        over = components_of(RewardWeights(overtake_sign=sign), step)["over"][:, 0]
        assert over[winner] == pytest.approx(STAGE.w_over)
        assert over[1 - winner] == 0


def test_collision_and_nearness_terms() -> None:
    step, weights = random_step(3), REWARDS["default"]
    ours = components_of(weights, step)
    np.testing.assert_allclose(ours["coll"], -STAGE.w_coll * step["collided"], atol=1e-6)
    closer = np.clip(weights.near_distance - step["nearest"], 0, None)
    np.testing.assert_allclose(ours["near"], -weights.w_near * closer, atol=1e-6)
    assert components_of(REWARDS["paper"], step)["near"].max() == 0


def test_stages_without_collision_penalty_have_none() -> None:
    for stage in CURRICULUM:
        coll = components_of(REWARDS["paper"], random_step(4), rules_of(stage))["coll"]
        assert (coll.min() < 0) == stage.collision_penalty
        assert coll.min() == pytest.approx(-stage.w_coll)


def test_a_drone_at_rest_is_not_misaligned() -> None:
    step = random_step(5)
    step["v1"] = np.zeros_like(step["v1"])
    assert (components_of(REWARDS["paper"], step)["align"] == 0).all()


@functools.cache
def _total(weights: RewardWeights) -> Callable[..., jax.Array]:
    reward = make_reward(weights)

    def compute(rules, components, passed, offset, ended):
        step = step_of(random_arrays(), rules, crossing_of(passed, offset))
        passing = {name: reward.components(step)[name] for name in reward.of_phase("passing")}
        return reward.total(rules, components | passing, passed, ended)

    return jax.jit(compute)


def random_arrays() -> dict[str, jax.Array]:
    return {k: jnp.asarray(v, bool if v.dtype == bool else jnp.float32) for k, v in random_step().items()}


def total(
    weights: RewardWeights, components: dict, passed: object, offset: object, ended: object, crash_share: float = 1.0
) -> np.ndarray:
    """The package's reward of a step."""
    passed, ended = jnp.asarray(passed), jnp.asarray(ended)
    offset = jnp.asarray(offset, jnp.float32)
    return np.asarray(_total(weights)(rules_of(crash_share=crash_share), components, passed, offset, ended))


def random_totals(weights: RewardWeights) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(6)
    components = components_of(weights, random_step(6))
    passed, ended = (rng.random((DRONES, RACES)) < 0.3 for _ in range(2))
    return components, passed, rng.uniform(-1, 0.5, (DRONES, RACES)), ended


@pytest.mark.parametrize("preset", REWARDS)
def test_the_total_is_the_clipped_sum_or_the_end(preset: str) -> None:
    weights = REWARDS[preset]
    components, passed, offset, ended = random_totals(weights)
    reward = total(weights, components, passed, offset, ended)
    plain = np.clip(sum(components.values()), -weights.clip, weights.clip)
    flying = ~passed & ~ended
    np.testing.assert_allclose(reward[flying], plain[flying], atol=1e-5)
    np.testing.assert_array_equal(reward[ended], np.float32(weights.terminal))
    cheaper = total(weights, components, passed, offset, ended, crash_share=0.25)
    np.testing.assert_allclose(cheaper[ended], 0.25 * weights.terminal)
    np.testing.assert_array_equal(cheaper[~ended], reward[~ended])
    assert reward[~ended].min() >= -weights.clip
    assert reward.max() <= max(weights.clip, weights.gate_bonus)
    assert (np.abs(plain) == weights.clip).any()


def test_progress_may_be_paid_up_to_v_min_alone() -> None:
    """At twice v_min half of it, at half of v_min all of it; nothing else changes."""
    step = random_step(8)
    speed = np.linalg.norm(step["v1"], axis=0)
    weights = REWARDS["default"]
    capped = replace(weights, pay_up_to_v_min=True)
    for v_min in (0.5, 3.0, 50.0):
        rules = rules_of(STAGE, v_min=v_min)
        usual, paid = (components_of(w, step, rules) for w in (weights, capped))
        share = np.minimum(1, v_min / np.maximum(speed, 1e-9))
        np.testing.assert_allclose(paid.pop("prog"), usual.pop("prog") * share, atol=1e-5)
        for name, value in usual.items():
            np.testing.assert_array_equal(paid[name], value)


def test_printed_weights_reward_a_passed_gate_with_one_and_an_end_with_minus_one() -> None:
    weights = REWARDS["paper"]
    components, passed, offset, ended = random_totals(weights)
    alone = {k: np.zeros_like(v) if k in ("over", "coll", "near") else v for k, v in components.items()}
    reward = total(weights, alone, passed, offset, ended)
    np.testing.assert_array_equal(reward[passed & ~ended], 1.0)
    np.testing.assert_array_equal(reward[ended], -1.0)
    assert (weights.w_prox, weights.w_prog, weights.w_align, weights.w_speed) == (0.52, 1.51, 0.17, 0.2)
    assert (weights.proximity_decay, weights.proximity_range, weights.progress_scale) == (2.0, 10.0, 2.5)


def test_a_pass_near_the_edge_earns_less_never_more() -> None:
    weights = REWARDS["default"]
    components, _, _, _ = random_totals(weights)
    quiet = {k: np.zeros_like(v) for k, v in components.items()}
    yes, no = np.ones((DRONES, RACES), bool), np.zeros((DRONES, RACES), bool)
    offsets = np.linspace(-1, 0.5, DRONES * RACES)
    rewards = total(weights, quiet, yes, offsets.reshape(DRONES, RACES), no).ravel()
    assert rewards[0] == pytest.approx(weights.gate_bonus)
    assert (np.diff(rewards) <= 1e-6).all()
