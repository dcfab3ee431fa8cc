"""A best response as a second-order cone programme, written down anew and solved by Clarabel in double precision."""

from typing import NamedTuple

import clarabel
import numpy as np
from scipy import sparse


class Oracle(NamedTuple):
    """The optimum of one drone's best response."""

    position_w: np.ndarray  # [3, K]
    collision: np.ndarray  # [M, K] multipliers
    objective: float  # the largest


def one_drone(programme, drone, race):
    """The part of a batch of programmes that concerns one drone of one race, as NumPy arrays in double precision."""
    return type(programme)(*(np.asarray(a, np.float64)[..., drone, race] for a in programme))


def terms(programme, algorithm):
    """The programme as `minimise x P x / 2 + q x, b - A x in a cone`, with x = (positions step by step, slacks)."""
    steps, opponents, dt, weights = programme.speed.shape[0], len(programme.reach), algorithm.dt, algorithm.weights
    size, hinges = 3 * steps, (4 + opponents) * steps
    one_step = np.eye(steps) - np.eye(steps, k=-1)
    velocity, velocity0 = np.kron(one_step, np.eye(3)) / dt, np.zeros(size)
    velocity0[:3] = -programme.position_w / dt
    before = np.zeros(size)
    before[:3] = -programme.velocity_w / dt
    acceleration = np.kron(one_step, np.eye(3)) / dt @ velocity
    acceleration0 = np.kron(one_step, np.eye(3)) / dt @ velocity0 + before

    centre = programme.centre_w.T.ravel()
    quadratic = weights.acceleration * acceleration.T @ acceleration + weights.centre * np.eye(size)
    linear = weights.acceleration * acceleration.T @ acceleration0 - weights.centre * centre
    linear = linear - programme.reward.T.ravel()
    costs = np.concatenate([np.full(4 * steps, weights.corridor), np.full(opponents * steps, weights.collision)])

    rows, limits = [], []  # of rows x <= limits + slack
    for axis, low, high in zip((programme.left_w, programme.up_w), programme.low, programme.high, strict=True):
        normal = sparse.block_diag(axis.T[:, None, :]).toarray()
        here = (axis * programme.centre_w).sum(axis=0)
        rows += [normal, -normal]
        limits += [high + here, -low - here]
    for towards, reach in zip(np.moveaxis(programme.towards_w, 1, 0), programme.reach, strict=True):
        rows.append(sparse.block_diag(towards.T[:, None, :]).toarray())
        limits.append(reach)
    soft = np.hstack([np.vstack(rows), -np.eye(hinges)])
    positive = np.hstack([np.zeros((hinges, size)), -np.eye(hinges)])

    blocks, right, cones = [soft, positive], [np.concatenate(limits), np.zeros(hinges)], [2 * hinges]
    for k in range(steps):
        blocks.append(_padded(-velocity[3 * k : 3 * k + 3], hinges))
        right.append(np.concatenate([[programme.speed[k]], velocity0[3 * k : 3 * k + 3]]))
    if algorithm.limit == "ball":
        for k in range(steps):
            blocks.append(_padded(-acceleration[3 * k : 3 * k + 3], hinges))
            right.append(np.concatenate([[programme.acceleration], acceleration0[3 * k : 3 * k + 3]]))
    else:
        box = np.vstack([acceleration, -acceleration])
        blocks.append(np.hstack([box, np.zeros((2 * size, hinges))]))
        right.append(programme.acceleration - np.concatenate([acceleration0, -acceleration0]))
    balls = (2 if algorithm.limit == "ball" else 1) * steps
    cones = [clarabel.NonnegativeConeT(2 * hinges), *[clarabel.SecondOrderConeT(4)] * balls]
    if algorithm.limit == "box":
        cones.append(clarabel.NonnegativeConeT(2 * size))
    constant = weights.acceleration / 2 * acceleration0 @ acceleration0 + weights.centre / 2 * centre @ centre
    matrix = sparse.csc_matrix(sparse.block_diag([np.triu(quadratic), np.zeros((hinges, hinges))]))
    return matrix, np.concatenate([linear, costs]), np.vstack(blocks), np.concatenate(right), cones, constant


def _padded(rows, hinges):
    """A second-order cone's rows: nothing in front for the radius, nothing behind for the slacks."""
    return np.hstack([np.vstack([np.zeros(rows.shape[1]), rows]), np.zeros((4, hinges))])


def optimum(programme, algorithm):
    """Solve one drone's programme."""
    steps, opponents = programme.speed.shape[0], len(programme.reach)
    matrix, linear, a, b, cones, constant = terms(programme, algorithm)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(matrix, linear, sparse.csc_matrix(a), b, cones, settings).solve()
    assert str(solution.status) == "Solved", solution.status
    collision = np.array(solution.z)[4 * steps : (4 + opponents) * steps].reshape(opponents, steps)
    position = np.array(solution.x)[: 3 * steps].reshape(steps, 3).T
    return Oracle(position, collision, -(solution.obj_val + constant))


def objective(programme, algorithm, position_w):
    """What a best response gains and costs by its positions, whether or not it keeps the hard limits."""
    weights, dt = algorithm.weights, algorithm.dt
    points = np.concatenate([programme.position_w[:, None], position_w], axis=1)
    velocity = np.concatenate([programme.velocity_w[:, None], np.diff(points, axis=1) / dt], axis=1)
    acceleration = np.diff(velocity, axis=1) / dt
    offset = position_w - programme.centre_w
    outside = 0.0
    for axis, low, high in zip((programme.left_w, programme.up_w), programme.low, programme.high, strict=True):
        along = (axis * offset).sum(axis=0)
        outside += np.maximum(along - high, 0).sum() + np.maximum(low - along, 0).sum()
    along = (programme.towards_w * position_w[:, None]).sum(axis=0)
    near = np.maximum(along - programme.reach, 0).sum()
    quadratic = weights.acceleration / 2 * (acceleration**2).sum() + weights.centre / 2 * (offset**2).sum()
    return (programme.reward * position_w).sum() - weights.corridor * outside - weights.collision * near - quadratic
