"""The race as other libraries know environments: Gymnasium, PettingZoo, Stable-Baselines3."""
