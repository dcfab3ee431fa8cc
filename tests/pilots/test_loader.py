"""Python files that a user names: each finds what lies beside it, and nobody else's."""

import sys

import pytest

from cruise.errors import CruiseError
from cruise.pilots.loader import load_module, load_object

# How a file may ask for what lies beside it, in a function `up` that says which helper it got.
STYLES = {
    "at the top": "import helper\ndef up(): return helper.UP",
    "by name": "from helper import UP\ndef up(): return UP",
    "under another name": "import helper as h\ndef up(): return h.UP",
    "lazily": "def up():\n    from helper import UP\n    return UP",
    "from a package": "from parts.inner import UP\ndef up(): return UP",
    "a package's module": "import parts.inner\ndef up(): return parts.inner.UP",
    "a package's module, lazily": "def up():\n    import parts.inner as inner\n    return inner.UP",
    "importlib": "import importlib\ndef up(): return importlib.import_module('helper').UP",
    "importlib of a package": "from importlib import import_module\ndef up(): return import_module('parts.inner').UP",
    "__import__": "def up(): return __import__('helper').UP",
    "through another": "import through\ndef up(): return through.helper.UP",
    "through another, lazily": "import through\ndef up(): return through.later()",
    "relatively": "from .helper import UP\ndef up(): return UP",
    "an installed name": "import tyro\ndef up(): return tyro.UP",
}


@pytest.fixture
def teams(tmp_path):
    """Two folders with the same names of modules and other contents."""
    for team, value in (("a", 0.3), ("b", -0.3)):
        folder = tmp_path / team
        (folder / "parts").mkdir(parents=True)
        (folder / "helper.py").write_text(f"UP = {value}\n")
        (folder / "tyro.py").write_text(f"UP = {value}\n")
        (folder / "parts" / "__init__.py").write_text("")
        (folder / "parts" / "core.py").write_text("import helper\n")
        (folder / "parts" / "inner.py").write_text("from .core import helper\nUP = helper.UP\n")
        (folder / "through.py").write_text("import helper\ndef later():\n    import helper as h\n    return h.UP\n")
    return tmp_path


@pytest.mark.parametrize("style", STYLES)
def test_each_file_has_its_own_helpers(style, teams):
    before = set(sys.path)
    for team in "ab":
        (teams / team / "pilot.py").write_text(STYLES[style] + "\n")
    up_a, up_b = (load_object(f"{teams / team}/pilot.py:up") for team in "ab")
    assert [up_a(), up_b(), up_a()] == [0.3, -0.3, 0.3]
    assert set(sys.path) == before
    assert "helper" not in sys.modules
    assert "parts" not in sys.modules


def test_what_is_installed_stays_what_it_is(teams):
    """The standard library and this package are never taken from beside a file, nor a folder for a package."""
    folder = teams / "a"
    for name in ("json.py", "cruise.py"):
        (folder / name).write_text("UP = 1\n")
    (folder / "numpy").mkdir()
    (folder / "numpy" / "notes.txt").write_text("")
    (folder / "pilot.py").write_text("import json, cruise, numpy\nimport importlib.util as util\n")
    module = load_module(f"{folder}/pilot.py")
    import json

    import numpy

    import cruise

    assert (module.json, module.cruise, module.numpy) == (json, cruise, numpy)
    assert module.util.find_spec("json") is not None


def test_a_file_and_its_helpers_may_need_each_other(teams):
    folder = teams / "a"
    (folder / "friend.py").write_text("import pilot\ndef size(): return pilot.SIZE\n")
    (folder / "pilot.py").write_text("SIZE = 3\nimport friend\ndef size(): return friend.size()\n")
    assert load_object(f"{folder}/pilot.py:size")() == 3


def test_classes_can_be_pickled_and_dataclasses_resolved(teams):
    import pickle

    top = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    (teams / "a" / "pilot.py").write_text(f"{top}@dataclass\nclass Pilot:\n    gain: float = 2\n")
    kind = load_object(f"{teams}/a/pilot.py:Pilot")
    assert pickle.loads(pickle.dumps(kind(3))) == kind(3)


def test_a_fault_beside_the_file_is_told_by_its_place_and_is_gone_when_mended(teams):
    helper, pilot = teams / "a" / "helper.py", teams / "a" / "pilot.py"
    pilot.write_text("import helper\nUP = helper.UP\n")
    helper.write_text("\nUP = 1 / 0\n")
    with pytest.raises(CruiseError, match=r"pilot.py cannot be run: ZeroDivisionError: .*helper.py, line 2\)"):
        load_module(str(pilot))
    helper.write_text("UP = 12345\n")
    assert load_object(f"{pilot}:UP") == 12345
    pilot.write_text("import helper.nothing\n")
    with pytest.raises(CruiseError, match=r"No module named 'helper.nothing'; 'helper' is not a package"):
        load_module(str(pilot))


def test_messages_name_what_was_asked_for(tmp_path):
    with pytest.raises(CruiseError, match=r"terms file .*none.py does not exist$"):
        load_module(f"{tmp_path}/none.py", "terms")
    with pytest.raises(CruiseError, match=r"terms 'x.py' does not say what is meant: .* x.py:Name"):
        load_object("x.py", "terms")
    for place in ("nul\0byte.py", f"{'x' * 5000}.py"):
        with pytest.raises(CruiseError) as error:
            load_module(place)
        assert "\n" not in str(error.value)
