"""Without the libraries behind the adapters there is one clear line."""

import sys

import pytest

import cruise
from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.extras import how_to_install
from cruise.storage.onnx_file import load_runtime


def forget(monkeypatch, library):
    """As if it were not installed."""
    for name in [
        name for name in sys.modules if name.partition(".")[0] == library or name.startswith("cruise.adapters.p")
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)


def test_pettingzoo_is_missing(monkeypatch):
    forget(monkeypatch, "pettingzoo")
    for door in (cruise.parallel_env, lambda: cruise.vector_parallel_env(3)):
        with pytest.raises(CruiseError, match=r"pettingzoo is not installed: pip install .*'pettingzoo>="):
            door()


def test_onnx_is_missing(monkeypatch, tmp_path, capsys):
    forget(monkeypatch, "onnxruntime")
    with pytest.raises(CruiseError, match=r"need onnxruntime: pip install .*'onnxruntime>="):
        load_runtime()
    (tmp_path / "policy.onnx").write_bytes(b"model")
    assert main(["race", "--pilot", str(tmp_path / "policy.onnx")]) == 2
    assert capsys.readouterr().err == f"error: ONNX models need onnxruntime: {how_to_install('onnx')}\n"
