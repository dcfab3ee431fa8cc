"""`cruise export`: what it writes flies, and it says how near it comes."""

import re

import pytest

from cruise.cli.line_up import LineUp
from cruise.cli.main import main
from cruise.export.c_harness import compiler
from tests.storage.policies import write_policy


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_export(tmp_path, capsys):
    write_policy(tmp_path / "duel", name="duel")
    assert main(["export", "duel", "--onnx", "out/duel.onnx", "--c", "duel.h", "--measure"]) == 0 or compiler() is None
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"out/duel.onnx: \d+ kB, within \d\.\de-\d\d of the policy in [\d,]+ recorded actions, "
                        r"[\d.]+ us an action", lines[0])  # fmt: skip
    if compiler() is not None:
        assert re.fullmatch(r"duel.h: \d+ kB, within .* recorded actions, [\d.]+ us an action", lines[1])
        assert "#ifndef CRUISE_DUEL_H" in (tmp_path / "duel.h").read_text()
    match = LineUp(pilot=("out/duel.onnx",)).match()  # it knows its track and number of drones
    assert (match.track.name, [pilot.name for pilot in match.team]) == ("ring", ["duel", "duel"])


BAD = {
    "nothing": ([], "nothing to write: give --onnx FILE.onnx, --c FILE.h or --lsy FILE.py"),
    "network in c": (["--c", "p.h", "--network"], "--network is about the ONNX model"),
    "ending": (["--onnx", "p.txt"], "--onnx must name a .onnx file"),
    "header's ending": (["--c", "p.c"], "--c must name a .h file"),
    "a track that does not fit": (["--onnx", "p.onnx", "--track", "nowhere"], "unknown track 'nowhere'"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_flags_give_one_line_and_no_files(case, tmp_path, capsys):
    flags, message = BAD[case]
    write_policy(tmp_path / "duel", name="duel")
    before = sorted(tmp_path.rglob("*"))
    assert main(["export", "duel", *flags]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before
