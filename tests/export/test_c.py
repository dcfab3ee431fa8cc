"""The C header compiles without a warning and does what the policy does in JAX."""

import shutil
import subprocess

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.export import c_harness
from cruise.export.c_harness import compiler, run_header
from cruise.export.c_header import c_header, literal, prefix_of
from tests.export.conftest import AGILE, ATOL, KINDS, lost_others, policy_of

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler here")


@needs_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_the_compiled_header_does_as_the_policy(kind, exporters, tmp_path):
    exporter = exporters(kind)
    header = c_header(exporter.policy, exporter.track, exporter.env, exporter.recording)
    run = run_header(header, prefix_of(exporter.policy), exporter.recording, tmp_path)
    for name, wanted in exporter.recording.said.items():
        np.testing.assert_allclose(run.said[name], wanted, atol=ATOL[name], err_msg=name)
    np.testing.assert_allclose(run.command, exporter.recording.commands, atol=1e-4)
    assert run.self_test <= 1e-5


CALLER = """#include "policy.h"
float fly(float command[4]);
float fly(float command[4]) {{
    {p}_state state = {P}_START;
    {p}_act(&state, {p}_gates, {P}_GATES);
    {p}_{command}(&state, command);
    {p}_advance(&state);
    return {p}_self_test();
}}
"""
STRICT = ("-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-c", "-o", "caller.o")


@pytest.mark.parametrize("kind", ["agile", "paper", "memory", "told"])
@pytest.mark.parametrize("cc", ["gcc", "g++", "clang", "clang++"])
def test_every_compiler_takes_the_header_without_a_warning(cc, kind, exporters, tmp_path):
    """As C99 and as C++17."""
    if shutil.which(cc) is None:
        pytest.skip(f"{cc} is not here")
    exporter = exporters(kind)
    prefix = prefix_of(exporter.policy)
    text = c_header(exporter.policy, exporter.track, exporter.env, exporter.recording)
    (tmp_path / "policy.h").write_text(text)
    command = "command" if kind in (*AGILE, "told") else "acceleration"
    source = "caller.cc" if cc.endswith("++") else "caller.c"
    (tmp_path / source).write_text(CALLER.format(p=prefix, P=prefix.upper(), command=command))
    standard = "-std=c++17" if cc.endswith("++") else "-std=c99"
    done = subprocess.run([cc, standard, *STRICT, source], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@needs_compiler
@pytest.mark.parametrize("kind", ["agile", "shipped", "paper", "memory"])
def test_sanitizers_find_nothing_and_who_left_the_air_may_be_anywhere(kind, exporters, tmp_path, monkeypatch):
    exporter = exporters(kind)
    lost = lost_others(exporter.recording)
    header = c_header(exporter.policy, exporter.track, exporter.env, exporter.recording)
    checks = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    monkeypatch.setattr(c_harness, "FLAGS", (*c_harness.FLAGS, *checks))
    run = run_header(header, prefix_of(exporter.policy), lost, tmp_path)
    assert np.abs(run.said["action"] - lost.outputs["action"]).max() <= 1e-5


@needs_compiler
def test_the_self_test_finds_a_fault(exporters, tmp_path):
    exporter = exporters("alone")
    header = c_header(exporter.policy, exporter.track, exporter.env, exporter.recording)
    prefix = prefix_of(exporter.policy)
    wrong = header.replace("tanhf(", "(")
    assert wrong != header
    assert run_header(wrong, prefix, exporter.recording, tmp_path).self_test > 1e-2
    infinite = header.replace("float sum = 0.0f;", "float sum = (float)NAN;")
    assert np.isnan(run_header(infinite, prefix, exporter.recording, tmp_path).self_test)


def test_numbers_read_back_as_they_were():
    for value in (*np.random.default_rng(0).standard_normal(200).tolist(), 0.0, -0.0, 1.0, 1e-30, 1e6, np.pi):
        text = literal(value)
        assert text.endswith("f")
        assert "." in text
        assert np.float32(text[:-1]) == np.float32(value)


def test_names_make_names_of_c():
    assert prefix_of(policy_of("shipped")) == "ring_4"
    assert prefix_of(policy_of("alone")) == "alone_policy"


def test_no_compiler_and_one_that_refuses(exporters, tmp_path, monkeypatch):
    exporter = exporters("alone")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(CruiseError, match="C compiler 'no-such-compiler' cannot be run: No such file"):
        run_header("", "p", exporter.recording, tmp_path)
    monkeypatch.setattr(c_harness.shutil, "which", lambda name: None)
    monkeypatch.delenv("CC")
    assert compiler() is None
    with pytest.raises(CruiseError, match="no C compiler found: name one with the variable CC"):
        run_header("", "p", exporter.recording, tmp_path)
    monkeypatch.undo()
    if compiler() is not None:
        with pytest.raises(CruiseError, match="refused the header: "):
            run_header("int x", "p", exporter.recording, tmp_path)
