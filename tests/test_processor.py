"""Wide vectors: asked for where nobody says otherwise, and compiled."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cruise.processor import use_wide_vectors

COMPILE = """
from cruise.cli.compilation import prepare_flight
prepare_flight()
import jax
jax.jit(lambda x: 2 * x).lower(jax.ShapeDtypeStruct((1000,), "float32")).compile()
"""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (None, "--xla_cpu_prefer_vector_width=512"),
        ("--xla_cpu_max_isa=AVX2", "--xla_cpu_max_isa=AVX2 --xla_cpu_prefer_vector_width=512"),
        ("--xla_cpu_prefer_vector_width=128", "--xla_cpu_prefer_vector_width=128"),
    ],
)
def test_what_the_user_says_stands(monkeypatch: pytest.MonkeyPatch, before: str | None, after: str) -> None:
    if before is None:
        monkeypatch.delenv("XLA_FLAGS", raising=False)
    else:
        monkeypatch.setenv("XLA_FLAGS", before)
    for _ in range(2):
        use_wide_vectors()
        assert os.environ["XLA_FLAGS"] == after


def test_commands_compile_for_them(tmp_path: Path) -> None:
    """Read off the machine-independent code that XLA hands to its compiler."""
    environment = os.environ | {"XLA_FLAGS": f"--xla_dump_to={tmp_path}", "JAX_ENABLE_COMPILATION_CACHE": "false"}
    subprocess.run([sys.executable, "-c", COMPILE], check=True, env=environment)
    code = "".join(path.read_text() for path in tmp_path.glob("*.ll"))
    assert '"prefer-vector-width"="512"' in code
    assert '"prefer-vector-width"="256"' not in code
