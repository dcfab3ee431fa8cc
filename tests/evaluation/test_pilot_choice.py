"""What a user names becomes the pilot he means, or one line that says what is wrong with the name."""

import sys

import pytest

from cruise.errors import CruiseError
from cruise.evaluation.pilot_choice import find_pilot, identity, pilot_meta
from cruise.pilots.foreign import ForeignPilot
from cruise.pilots.scripted import SCRIPTED, Chaser
from tests.storage.policies import write_policy

SOURCE = """
from dataclasses import dataclass
import helper

@dataclass
class Pilot:
    gain: float = helper.GAIN
    def act(self, view):
        return [self.gain] * 3

class Pylot(Pilot):
    name = "pylot"

def hold(view):
    return [0, 0, 0]

NUMBER = 7
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "own.py").write_text(SOURCE)
    (tmp_path / "helper.py").write_text("GAIN = 0.5\n")
    yield tmp_path
    for name in [name for name in sys.modules if name == "helper" or name.startswith(("own", "cruise_pilot_"))]:
        del sys.modules[name]


def test_every_way_to_name_a_pilot(folder):
    path = write_policy(folder / "policy", name="novice")
    assert find_pilot("chaser") is SCRIPTED["chaser"]
    assert find_pilot(path).name == find_pilot(str(folder / "policy")).name == "novice"
    fast = Chaser(name="fast")
    assert find_pilot(fast) is fast
    for choice, name in (
        ("own.py:Pilot", "own.py:Pilot"),
        (f"{folder}/own.py:hold", f"{folder}/own.py:hold"),
        ("own:Pylot", "pylot"),
        ("cruise.pilots.scripted:Chaser", "chaser"),
    ):
        assert find_pilot(choice).name == name
    assert find_pilot("own.py:Pilot", budget=0.5).budget == 0.5
    assert isinstance(find_pilot(lambda view: [0, 0, 0]), ForeignPilot)


def test_what_is_known_of_them(folder):
    write_policy(folder / "policy", name="novice", track="figure-eight")
    assert pilot_meta("policy").track == "figure-eight"
    assert pilot_meta("own.py:Pilot") is pilot_meta("hover") is pilot_meta(Chaser()) is None
    assert identity("policy") == identity("policy") != identity("own.py:Pilot")


BAD = {
    "no file": ("my.py:Pilot", "pilot file my.py does not exist; `cruise new-pilot my.py` writes one"),
    "no name": ("own.py", "'own.py' does not say what flies: give a name in that file, as in own.py:Pilot"),
    "empty name": ("own.py:", "give a name in that file, as in own.py:Pilot"),
    "another name": (
        "own.py:Pilt",
        "nothing is called 'Pilt' there: did you mean 'Pilot'? it defines Pilot, Pylot, hold",
    ),
    "no pilot": ("own.py:NUMBER", "pilot 'own.py:NUMBER' is of type int: expected a function or a class"),
    "no module": ("nowhere.at.all:Pilot", "pilot module nowhere.at.all cannot be imported: ModuleNotFoundError"),
    "bad syntax": ("broken.py:Pilot", "pilot file broken.py cannot be run: SyntaxError: "),
    "raises": ("raises.py:Pilot", "raises.py cannot be run: ZeroDivisionError: division by zero ("),
    "line of the fault": ("raises.py:Pilot", "raises.py, line 2)"),
    "leaves": ("leaves.py:Pilot", "leaves.py cannot be run: SystemExit: 3"),
    "a model that is not there": ("gone.onnx", "model gone.onnx does not exist"),
    "a model that is none": ("text.onnx", "model text.onnx: not a sound ONNX model"),
    "a typing error": ("chasr", "policy 'chasr' not found"),
}


@pytest.mark.parametrize("case", BAD)
def test_names_that_mean_nothing(case, folder):
    (folder / "broken.py").write_text("class Pilot:\n    def act(self view)\n")
    (folder / "raises.py").write_text("\nx = 1 / 0\n")
    (folder / "leaves.py").write_text("raise SystemExit(3)\n")
    (folder / "text.onnx").write_text("no model")
    choice, message = BAD[case]
    with pytest.raises(CruiseError) as error:
        find_pilot(choice)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
