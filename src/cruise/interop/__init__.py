"""Other people's simulators, flown through as if they were ours."""
