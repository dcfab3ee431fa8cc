"""Learning libraries on the races, each connected as its own documentation says: `make clients` installs and runs them.

Each line is one library: environment steps, and seconds with all that it compiles and imports.
"""

import subprocess
import sys
import time

STEPS = 10_000


def stable_baselines3() -> int:
    """PPO on races in one compiled step."""
    from stable_baselines3 import PPO

    from cruise.adapters.sb3 import StableBaselinesEnv

    env = StableBaselinesEnv(64, drones=1)
    return PPO("MlpPolicy", env, n_steps=64, batch_size=1024, device="cpu").learn(STEPS).num_timesteps


def sb3_contrib() -> int:
    """TRPO likewise."""
    from sb3_contrib import TRPO

    from cruise.adapters.sb3 import StableBaselinesEnv

    env = StableBaselinesEnv(64, drones=1)
    return TRPO("MlpPolicy", env, n_steps=64, batch_size=1024, device="cpu").learn(STEPS).num_timesteps


def sbx() -> int:
    """Its PPO likewise, which is JAX beside JAX."""
    from sbx import PPO

    from cruise.adapters.sb3 import StableBaselinesEnv

    return PPO("MlpPolicy", StableBaselinesEnv(64, drones=1), n_steps=64, batch_size=1024).learn(STEPS).num_timesteps


def supersuit() -> int:
    """PPO by a policy that all drones share, in two forked workers."""
    import supersuit as ss
    from stable_baselines3 import PPO

    import cruise

    env = ss.pettingzoo_env_to_vec_env_v1(ss.black_death_v3(cruise.parallel_env(drones=2)))
    env = ss.concat_vec_envs_v1(env, 2, num_cpus=2, base_class="stable_baselines3")
    steps = PPO("MlpPolicy", env, n_steps=256, batch_size=256, device="cpu").learn(STEPS).num_timesteps
    env.close()  # or its workers, and this process, never end
    return steps


def torchrl() -> int:
    """Rollouts of a single race, and of all its agents."""
    from torchrl.envs import GymEnv, PettingZooWrapper

    import cruise.gym

    single = GymEnv("cruise/Race-v0", drones=1)
    steps = 0
    while steps < STEPS // 2:
        steps += single.rollout(500)["next", "reward"].shape[0]
    agents = PettingZooWrapper(cruise.parallel_env(drones=2), use_mask=True)
    while steps < STEPS:
        steps += 2 * agents.rollout(500)["next", "done"].shape[0]
    return steps


def skrl() -> int:
    """Its wrapper of the vector environment, random actions."""
    import gymnasium
    import torch
    from skrl.envs.wrappers.torch import wrap_env

    env = wrap_env(gymnasium.make_vec("cruise.gym:cruise/Race-v0", 8, drones=1))
    env.reset()
    for _ in range(STEPS // 8):
        env.step(torch.rand(8, 3) * 2 - 1)
    return STEPS


CLIENTS = {one.__name__: one for one in (stable_baselines3, sb3_contrib, sbx, supersuit, torchrl, skrl)}


def main() -> int:
    """Every client in a process of its own, as its users have it; 1 where one fails."""
    failed = 0
    for name in sys.argv[1:] or CLIENTS:
        began = time.monotonic()
        code = f"from benchmarks.clients import CLIENTS; print(CLIENTS[{name!r}]())"
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        seconds = time.monotonic() - began
        last = (run.stdout if run.returncode == 0 else run.stderr).strip().splitlines()[-1:]
        said = f"{last[0]} steps" if run.returncode == 0 else f"FAILED: {' '.join(last)}"
        print(f"{name:18} {said}, {seconds:.0f} s", flush=True)
        failed += run.returncode != 0
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
