"""Other simulators of many quadrotors at once, as they come. Units are control steps of one drone."""

import os

import numpy as np

DRONES = 2048
STEPS = 50  # per call
CONTROL_RATE = 50  # [Hz]
TORCH_DRONES, TORCH_STEPS = 512, 5


class Crazyflow:
    """Crazyflow's first-principles dynamics with its own body-rate loop: one Crazyflie in each of many worlds."""

    def __init__(self, control_rate: int = CONTROL_RATE, rate: int = 500) -> None:
        """Physics and body-rate loop run at `rate` [Hz], actions change at `control_rate` [Hz]."""
        os.environ.setdefault("SCIPY_ARRAY_API", "1")  # or its rotations refuse JAX's arrays
        import jax  # noqa: PLC0415
        import jax.numpy as jnp  # noqa: PLC0415
        from crazyflow.control import Control  # noqa: PLC0415
        from crazyflow.sim import Sim  # noqa: PLC0415
        from crazyflow.sim import functional as crazyflow  # noqa: PLC0415

        sim = Sim(n_worlds=DRONES, control=Control.body_rate, freq=rate)
        substeps = rate // control_rate
        self.work, self._wait = float(DRONES * STEPS), jax.block_until_ready
        random = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, DRONES, 1, 4))
        weight = float(np.asarray(sim.data.params.mass).mean()) * 9.81
        actions = jnp.asarray(random * (1.0, 1.0, 1.0, 0.3 * weight) + (0.0, 0.0, 0.0, weight), jnp.float32)

        def fly(data):  # noqa: ANN001, ANN202
            def step(data, action):  # noqa: ANN001, ANN202
                return sim._step(crazyflow.body_rate_control(data, action), n_steps=substeps), None

            return jax.lax.scan(step, data, actions)[0]

        self._fly = jax.jit(fly)
        self._data = sim.data
        self()

    def __call__(self) -> None:
        """Fly on under random rates and thrusts."""
        self._data = self._wait(self._fly(self._data))


def crazyflow() -> Crazyflow:
    """50 actions a second over physics at 500 Hz."""
    return Crazyflow()


def crazyflow_own() -> Crazyflow:
    """Its own default: an action for every step of the physics, 500 a second."""
    return Crazyflow(control_rate=500)


class CrazyflowRoom:
    """Crazyflow's own environment of Gymnasium, a velocity to reach, under random attitudes and thrusts."""

    def __init__(self, rooms: int = 1024) -> None:
        """50 actions a second over physics at 500 Hz, episodes that end begun anew."""
        os.environ.setdefault("SCIPY_ARRAY_API", "1")
        from crazyflow.envs.reach_vel_env import ReachVelEnv  # noqa: PLC0415

        self.work = float(rooms * STEPS)
        self._env = ReachVelEnv(num_envs=rooms, freq=CONTROL_RATE)
        self._env.reset(seed=0)
        low, high = self._env.single_action_space.low, self._env.single_action_space.high
        self._actions = np.random.default_rng(0).uniform(low, high, (STEPS, rooms, len(low))).astype(np.float32)
        self()

    def __call__(self) -> None:
        """Step all rooms; NumPy out, as Gymnasium's libraries take it."""
        for actions in self._actions:
            observation, *_ = self._env.step(actions)
            for part in observation.values():
                np.asarray(part)


class Rotorpy:
    """RotorPy's batched quadrotor in PyTorch: thrust and body rates at 50 Hz, a Runge-Kutta step each."""

    def __init__(self) -> None:
        """Crazyflies hovering far above the ground."""
        import roma  # noqa: F401, PLC0415  (RotorPy goes on without these two until it needs them)
        import torch  # noqa: PLC0415
        import torchdiffeq  # noqa: F401, PLC0415
        from rotorpy.vehicles.crazyflie_params import quad_params  # noqa: PLC0415
        from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams  # noqa: PLC0415

        self.work = float(TORCH_DRONES * TORCH_STEPS)
        device, n = torch.device("cpu"), TORCH_DRONES

        def rows(*values: float) -> "torch.Tensor":
            return torch.tensor(values, dtype=torch.float64).repeat(n, 1)

        self._state = {
            "x": rows(0, 0, 100),
            "v": rows(0, 0, 0),
            "q": rows(0, 0, 0, 1),
            "w": rows(0, 0, 0),
            "wind": rows(0, 0, 0),
            "rotor_speeds": rows(*[1788.53] * 4),
        }
        params = BatchedMultirotorParams([quad_params] * n, n, device)
        self._vehicle = BatchedMultirotor(params, n, self._state, device, "cmd_ctbr", integrator="rk4")
        random = torch.as_tensor(np.random.default_rng(0).uniform(-1.0, 1.0, (TORCH_STEPS, n, 4)))
        weight = quad_params["mass"] * 9.81
        self._commands = [{"cmd_thrust": weight * (1 + 0.3 * one[:, :1]), "cmd_w": one[:, 1:]} for one in random]
        self()

    def __call__(self) -> None:
        """Fly on under random rates and thrusts."""
        for command in self._commands:
            self._state = self._vehicle.step(self._state, command, 1 / CONTROL_RATE)
