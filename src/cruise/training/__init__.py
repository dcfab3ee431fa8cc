"""PPO, the curriculum and self-play. Knows no screen: training is a generator."""
