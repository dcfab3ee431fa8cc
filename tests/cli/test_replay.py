"""`cruise replay`: a page from logs; one line where a log cannot be read."""

import numpy as np
import pytest

from cruise.cli import outputs
from cruise.cli.main import main
from tests.storage.logs import small_log


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.fixture
def opened(monkeypatch):
    """Addresses that were shown."""
    addresses = []
    monkeypatch.setattr(outputs.webbrowser, "open", addresses.append)
    return addresses


def test_page_is_written_beside_the_log_and_named(tmp_path, capsys, opened):
    small_log().save("logs/final.npz")
    assert main(["replay", "logs/final.npz"]) == 0
    assert capsys.readouterr().out == "replay   logs/final.html\n"
    assert b'"label":"final"' in (tmp_path / "logs" / "final.html").read_bytes()
    assert opened == []


def test_several_logs_a_ghost_and_a_browser(tmp_path, monkeypatch, opened):
    for name in ("a", "b", "c"):
        small_log().save(f"{name}.npz")
    monkeypatch.setattr(outputs, "has_display", lambda: True)
    assert main(["replay", "a.npz", "b.npz", "--ghost", "c.npz", "--html", "page.html", "--open"]) == 0
    page = (tmp_path / "page.html").read_bytes()
    assert page.count(b'"label":"') == 2
    assert page.count(b'"ghost":true') == 4
    assert opened == [(tmp_path / "page.html").as_uri()]


def test_without_a_display_nothing_is_opened(opened):
    small_log().save("a.npz")
    assert main(["replay", "a.npz", "--open"]) == 0
    assert opened == []


BAD = {
    "no log": ([], "name at least one race log"),
    "no such log": (["none.npz"], "race log none.npz does not exist"),
    "damaged": (["damaged.npz"], "race log damaged.npz: not a readable .npz file"),
    "no race": (["other.npz"], "race log other.npz: lacks array 'time'"),
    "too old": (["old.npz"], "race log old.npz: format version 0, this program reads"),
    "second is damaged": (["a.npz", "damaged.npz"], "race log damaged.npz: not a readable .npz file"),
    "ghost of another track": (["a.npz", "--ghost", "far.npz"], "the ghost flew track 'ring', whose gates are not"),
    "page of another kind": (["a.npz", "--html", "page.htm"], "--html must name a .html file"),
    "page is a folder": (["a.npz", "--html", "folder.html"], "--html folder.html is a folder"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gives_one_line_and_no_page(case, tmp_path, capsys):
    flags, message = BAD[case]
    small_log().save("a.npz")
    small_log(version=0).save("old.npz")
    small_log(gate_position=np.zeros((3, 3))).save("far.npz")
    (tmp_path / "damaged.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-100])
    np.savez("other.npz", position=np.zeros(3))
    (tmp_path / "folder.html").mkdir()
    before = sorted(tmp_path.rglob("*"))
    assert main(["replay", *flags]) == 2
    output = capsys.readouterr()
    assert output.err.startswith("error: ")
    assert message in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""
    assert sorted(tmp_path.rglob("*")) == before
