"""Wide vectors: asked for where nobody says otherwise, and compiled."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cruise.processor import run_in_real_time, use_wide_vectors

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


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone")
def test_real_time_is_for_all_threads_and_for_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[int, tuple[int, int]] = {}
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda thread, policy, param: asked.update({thread: (policy, param.sched_priority)})
    )
    assert run_in_real_time()
    assert os.getpid() in asked
    assert set(asked.values()) == {(os.SCHED_RR | os.SCHED_RESET_ON_FORK, 1)}

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert not run_in_real_time()


def test_commands_compile_for_them(tmp_path: Path) -> None:
    """Read off the machine-independent code that XLA hands to its compiler."""
    environment = os.environ | {"XLA_FLAGS": f"--xla_dump_to={tmp_path}", "JAX_ENABLE_COMPILATION_CACHE": "false"}
    subprocess.run([sys.executable, "-c", COMPILE], check=True, env=environment)
    code = "".join(path.read_text() for path in tmp_path.glob("*.ll"))
    assert '"prefer-vector-width"="512"' in code
    assert '"prefer-vector-width"="256"' not in code
