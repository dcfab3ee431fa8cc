"""What must be settled about the processor before JAX first compiles."""

import os

WIDTH = "xla_cpu_prefer_vector_width"


def use_wide_vectors() -> None:
    """Let compiled programs use vectors of 512 bits on processors that have them: left alone, XLA stops at 256.

    Its flags are read once, when it first compiles; after that this changes nothing. What the user says of the width in
    XLA_FLAGS stands. Sums are rounded in another order than with narrow vectors.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if WIDTH not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{WIDTH}=512".strip()
