"""Best responses against Clarabel on the same programmes, and the sensitivity against finite differences."""

import dataclasses

import jax
import numpy as np
import pytest

from cruise.pilots.se_ibr.admm import solve
from cruise.pilots.se_ibr.game import MOST_LOST, best_responses, linearised, what_others_lose
from cruise.pilots.se_ibr.options import Algorithm
from cruise.pilots.se_ibr.programme import no_multipliers
from tests.pilots.best_response_oracle import objective, one_drone, optimum
from tests.pilots.traffic import LINE, STYLE, bunch, guess_of

DRONES, RACES = 3, 6
ALONE = STYLE._replace(sensitivity=0.0)
PATIENT = 4000  # iterations
EACH = [(drone, race) for drone in range(DRONES) for race in range(RACES)]


@pytest.fixture(scope="module", params=["ball", "box"])
def algorithm(request):
    return Algorithm(limit=request.param)


@pytest.fixture(scope="module")
def programmes():
    """Of the fourth round of bunches of drones, sensitivities included, and the plan that it starts from."""
    traffic, progress = bunch(DRONES, (RACES,))
    rounds = jax.jit(lambda t, g: best_responses(LINE, Algorithm(), STYLE, t, g))
    plan = rounds(traffic, guess_of(Algorithm(), traffic, progress))
    programme, _ = jax.jit(lambda t, p: linearised(LINE, Algorithm(), STYLE, t, p, 0.5))(traffic, plan)
    assert np.abs(programme.reward[:, :-1]).max() > 0.01
    return programme, plan


@pytest.fixture(scope="module")
def patient(algorithm, programmes):
    """Solved with many iterations from nothing."""
    programme, plan = programmes
    many = dataclasses.replace(algorithm, iterations=PATIENT)
    start = plan.position_w, no_multipliers(DRONES, algorithm.horizon, (RACES,))
    return jax.jit(lambda p, s: solve(p, many, s))(programme, start)


@pytest.fixture(scope="module")
def optima(algorithm, programmes):
    return {case: optimum(one_drone(programmes[0], *case), algorithm) for case in EACH}


def test_oracle_solves_what_it_says(algorithm, programmes, optima):
    """The optimum's value is the programme's objective there, worked out without matrices."""
    for case, found in optima.items():
        own = objective(one_drone(programmes[0], *case), algorithm, found.position_w)
        assert own == pytest.approx(found.objective, rel=1e-4, abs=1e-4)


def test_positions_against_clarabel(algorithm, programmes, patient, optima):
    position, _ = patient
    off = [np.linalg.norm(position[:, :, i, e] - found.position_w, axis=0).max() for (i, e), found in optima.items()]
    assert np.median(off) < 1e-3
    assert np.max(off) < 0.02
    for (i, e), found in optima.items():
        own = objective(one_drone(programmes[0], i, e), algorithm, np.asarray(position[:, :, i, e], np.float64))
        assert own == pytest.approx(found.objective, rel=1e-3, abs=1e-3)


def test_multipliers_against_clarabel(patient, optima):
    _, multipliers = patient
    collision = np.asarray(multipliers.collision)
    assert collision.min() >= 0.0
    off = [np.abs(collision[:, :, i, e] - found.collision).max() for (i, e), found in optima.items()]
    assert max(found.collision.max() for found in optima.values()) > 0.1
    assert np.max(off) < 0.05


def test_hard_limits_hold(algorithm, programmes, patient):
    programme, _ = programmes
    position, _ = patient
    points = np.concatenate([programme.position_w[:, None], position], axis=1).astype(np.float64)
    velocity = np.diff(points, axis=1) / algorithm.dt
    assert (np.linalg.norm(velocity, axis=0) - programme.speed).max() < 1e-3
    velocity = np.concatenate([programme.velocity_w[:, None], velocity], axis=1)
    acceleration = np.diff(velocity, axis=1) / algorithm.dt
    norm = np.linalg.norm(acceleration, axis=0) if algorithm.limit == "ball" else np.abs(acceleration).max(axis=0)
    assert (norm - programme.acceleration).max() < 0.02


def test_few_iterations_from_the_last_plan_are_near(algorithm, programmes, optima):
    """As flown: the first step, which is what the vehicle gets of a plan, within 2 cm of the optimum's."""
    programme, plan = programmes
    position, _ = jax.jit(lambda p, s: solve(p, algorithm, s))(programme, (plan.position_w, plan.multipliers))
    off = [np.linalg.norm(position[:, 0, i, e] - found.position_w[:, 0]) for (i, e), found in optima.items()]
    assert np.median(off) < 0.02


def test_the_sensitivity_is_the_derivative_of_the_others_optimal_progress():
    """Moving drone 0 by d changes the optimum of drone 1, which has settled beside it, by -mu beta . d.

    Drone 1's programme is made anew for every position, direction to the moved drone included, and solved by Clarabel.
    """
    algorithm = Algorithm(rounds=1, iterations=1500, limit="box")
    traffic, progress = bunch(2, (8,), seed=5)
    given = guess_of(algorithm, traffic, progress)
    settle = jax.jit(lambda p: best_responses(LINE, algorithm, ALONE, traffic, p))
    plan = given
    for _ in range(20):  # drone 1 alone answers
        plan = settle(plan)
        plan = plan._replace(position_w=plan.position_w.at[:, :, 0].set(given.position_w[:, :, 0]))
    made = jax.jit(lambda p: linearised(LINE, algorithm, ALONE, traffic, p, 0.0)[0])
    lost = np.asarray(what_others_lose(plan.multipliers.collision, made(plan).towards_w))[:, :, 0]  # by drone 1
    mu = np.asarray(plan.multipliers.collision[0, :, 1])
    cases = [(int(mu[:, race].argmax()), race) for race in range(8) if 0.05 < mu[:, race].max() < MOST_LOST]
    assert len(cases) >= 2

    def others_optimum(step, race, offset):
        moved = plan.position_w.at[:, step, 0, race].add(offset)
        return optimum(one_drone(made(plan._replace(position_w=moved)), 1, race), algorithm).objective

    rng = np.random.default_rng(0)
    for step, race in cases:
        along = lost[:, step, race] / np.linalg.norm(lost[:, step, race])
        for direction in [along, *rng.normal(size=(2, 3)) / np.sqrt(3)]:
            change = others_optimum(step, race, 1e-3 * direction) - others_optimum(step, race, -1e-3 * direction)
            assert change / 2e-3 == pytest.approx(-lost[:, step, race] @ direction, abs=0.02)
