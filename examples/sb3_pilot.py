"""A model of Stable-Baselines3 as a pilot; `examples/train_sb3.py` trains one.

    PILOT_MODEL=runs/sb3/model.zip cruise race --track ring --drones 1 --pilot examples/sb3_pilot.py:Pilot
    PILOT_MODEL=runs/sb3/model.zip cruise evaluate --track ring --drones 1 --pilot examples/sb3_pilot.py:Pilot

It flies races of as many drones as it was trained with, because the size of what it sees depends on them. Loading such
a model runs code that is in it: load only what you trust.
"""

import os

from stable_baselines3 import PPO


class Pilot:
    """One object for all drones of all races: the network is asked once a step."""

    name = "SB3 PPO"
    agility = float(os.environ.get("PILOT_AGILITY", "4.0"))  # as in training
    observation = "extended"  # it sees what it saw in training, and speaks in the same frame

    def __init__(self):
        self.model = PPO.load(os.environ.get("PILOT_MODEL", "runs/sb3/model.zip"), device="cpu")

    def act_batch(self, view):
        """[M, O] observations to [M, 3] actions."""
        action, _ = self.model.predict(view.observation, deterministic=True)
        return action
