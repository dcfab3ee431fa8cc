"""The paper's environment as one writes it first: one race, drone after drone, in plain NumPy."""

import gymnasium
import numpy as np

from cruise.config import Stage, Track
from cruise.presets import CURRICULUM, REWARDS, TRACKS
from tests.dynamics.paper_reference import Drone, step
from tests.env.paper_reference import observation, r_align, r_coll, r_over, r_prog, r_prox, r_speed

EPISODE_STEPS = 2000  # as the paper has it
COLLISION_DISTANCE = 0.5  # as the paper trains [m]
LEAVE_DISTANCE = 10.0  # [m]
LANE = 1.25  # between two drones at the start [m]
WEIGHTS = REWARDS["paper"]


class PlainRace(gymnasium.Env):
    """Drone 0 learns, the others hold still in the air. Equations and numbers are the paper's.

    A gate is passed when the drone is within the tolerance of its plane at a sample, as in the paper's own code.
    """

    def __init__(self, drones: int = 4, track: Track = TRACKS["ring"], stage: Stage = CURRICULUM[-1]) -> None:
        self.drones, self.track, self.stage = drones, track, stage
        size = 13 + len(track.gates) + 4 * (drones - 1)
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Side by side before a random gate."""
        super().reset(seed=seed)
        number = int(self.np_random.integers(len(self.track.gates)))
        gate = self.track.gates[number]
        forward = np.array([np.cos(gate.yaw), np.sin(gate.yaw), 0.0])
        left = np.array([-np.sin(gate.yaw), np.cos(gate.yaw), 0.0])
        behind = np.array(gate.position_w) - self.np_random.uniform(1.5, 3.0) * forward
        lanes = (np.arange(self.drones) - (self.drones - 1) / 2) * LANE
        euler = np.array([0.0, 0.0, gate.yaw])
        self.fleet = [Drone(behind + lane * left, euler=euler.copy()) for lane in lanes]
        self.target = np.full(self.drones, number)
        self.flying = np.ones(self.drones, bool)
        self.steps = 0
        return self.look(0), {}

    def look(self, drone: int) -> np.ndarray:
        return observation(self.track, drone, self._race())

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """The learner flies; the others are asked to do nothing."""
        actions = np.zeros((self.drones, 3))
        actions[0] = action
        rewards, ended = self.fly(actions)
        return self.look(0), rewards[0], bool(ended[0]), self.steps >= EPISODE_STEPS, {}

    def fly(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Everybody flies [N, 3]; rewards and ends [N]."""
        before = self._race()
        self.fleet = [
            step(drone, action, self.stage.agility) for drone, action in zip(self.fleet, actions, strict=True)
        ]
        self.steps += 1
        after = self._race()
        ended = np.array([self._ended(drone, after) for drone in range(self.drones)])
        return np.array([self._reward(drone, before, after, ended[drone]) for drone in range(self.drones)]), ended

    def _race(self) -> dict[str, np.ndarray]:
        fleet = self.fleet
        state = {"p": [d.position for d in fleet], "v": [d.velocity for d in fleet], "euler": [d.euler for d in fleet]}
        return {name: np.stack(of_all, 1) for name, of_all in state.items()} | {
            "target": self.target.copy(),
            "flying": self.flying,
        }

    def _ended(self, drone: int, after: dict[str, np.ndarray]) -> bool:
        gates = np.array([gate.position_w for gate in self.track.gates])
        left = np.linalg.norm(gates - after["p"][:, drone], axis=1).min() > LEAVE_DISTANCE
        flipped = np.abs(after["euler"][:2, drone]).max() > np.pi / 2
        return bool(left or flipped or r_coll(drone, after["p"], self.flying, COLLISION_DISTANCE))

    def _reward(self, drone: int, before: dict, after: dict, ended: bool) -> float:
        if ended:
            return -1.0
        gate = self.track.gates[self.target[drone]]
        centre = np.array(gate.position_w)
        position, velocity = after["p"][:, drone], after["v"][:, drone]
        distance = float(np.linalg.norm(centre - position))
        if self._passes(drone, position):
            self.target[drone] = (self.target[drone] + 1) % len(self.track.gates)
            return 1.0
        w = WEIGHTS
        reward = w.w_prox * r_prox(distance)
        reward += w.w_prog * r_prog(float(np.linalg.norm(centre - before["p"][:, drone])), distance)
        reward -= w.w_align * r_align(position, velocity, centre)
        reward += w.w_speed * r_speed(velocity, self.stage.v_min)
        reward += self.stage.w_over * r_over(drone, before, after, self.flying, "paper", w.overtake_range)
        return float(np.clip(reward, -w.clip, w.clip))

    def _passes(self, drone: int, position: np.ndarray) -> bool:
        gate = self.track.gates[self.target[drone]]
        offset = position - np.array(gate.position_w)
        forward = np.cos(gate.yaw) * offset[0] + np.sin(gate.yaw) * offset[1]
        beside = np.cos(gate.yaw) * offset[1] - np.sin(gate.yaw) * offset[0]
        inside = abs(beside) < gate.width / 2 and abs(offset[2]) < gate.height / 2
        return abs(forward) < self.stage.gate_tolerance and bool(inside)
