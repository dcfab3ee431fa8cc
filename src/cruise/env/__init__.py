"""The racing environment as a learning problem."""
