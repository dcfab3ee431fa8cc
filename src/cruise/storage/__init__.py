"""Race logs, policies, checkpoints and configurations on disk, whole or not at all."""
