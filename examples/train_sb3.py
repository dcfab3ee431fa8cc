"""Train Stable-Baselines3's PPO on CRUISE, then measure it as every pilot is measured.

    pip install -e '.[gym]' stable-baselines3==2.9.2 torch==2.13.0
    python examples/train_sb3.py

It learns to fly the ring alone, under the rules of the third stage of the curriculum. For a race against others give
--drones 2 --opponent chaser, and more steps.
"""

import argparse
import os
import time
from pathlib import Path

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor
from torch import nn

import cruise
from cruise.adapters.sb3 import StableBaselinesEnv
from cruise.presets import CURRICULUM

PILOT = Path(__file__).with_name("sb3_pilot.py")
STAGE = 3


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--track", default="ring")
    parser.add_argument("--drones", type=int, default=1)
    parser.add_argument("--opponent", default=None, help="a pilot, as for cruise race --pilot")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--races", type=int, default=256, help="in parallel")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=100, help="races in which the result is measured")
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"))
    options = parser.parse_args()

    model = train(options)
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "model.zip"
    model.save(path)
    os.environ |= {"PILOT_MODEL": str(path), "PILOT_AGILITY": str(CURRICULUM[STAGE - 1].agility)}
    pilots = [f"{PILOT}:Pilot", *([options.opponent] * (options.drones - 1) if options.opponent else [])]
    result = cruise.evaluate(options.track, options.drones, pilots, options.episodes)
    mine = result.pilots[0]
    print(f"success {100 * mine.success_rate.mean:.1f} %, flying lap {mine.flying_lap_time.mean:.2f} s")
    flags = " ".join(f"--pilot {pilot}" for pilot in pilots)
    print(f"PILOT_MODEL={path} cruise evaluate --track {options.track} --drones {options.drones} {flags}")


def train(options):
    """A model, from races in parallel in one compiled step."""
    race = {"track": options.track, "drones": options.drones, "opponents": options.opponent, "stage": STAGE}
    env = VecMonitor(StableBaselinesEnv(options.races, **race), info_keywords=("gates_passed",))
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=64,
        batch_size=options.races * 64 // 8,
        n_epochs=4,
        learning_rate=1e-3,
        gae_lambda=0.98,
        ent_coef=0.005,
        policy_kwargs={"net_arch": [64, 64], "activation_fn": nn.Tanh, "log_std_init": -0.5},
        seed=options.seed,
        device="cpu",
    )
    return model.learn(options.steps, callback=Progress())


class Progress(BaseCallback):
    """A line now and then."""

    def __init__(self):
        super().__init__()
        self.began = self.told = time.monotonic()

    def _on_step(self):
        return True

    def _on_rollout_end(self):
        now = time.monotonic()
        if now - self.told < 5:
            return
        self.told = now
        last = list(self.model.ep_info_buffer)
        gates = sum(episode["gates_passed"] for episode in last) / max(len(last), 1)
        rate = self.num_timesteps / (now - self.began)
        print(f"{self.num_timesteps:>10,} steps, {rate:,.0f} steps/s, {gates:.1f} gates an episode", flush=True)


if __name__ == "__main__":
    main()
