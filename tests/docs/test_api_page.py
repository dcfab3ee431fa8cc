"""The page of the Python interface lists all that is public, and nothing that is not there."""

import importlib
import re

import cruise
from tests.docs.blocks import ROOT

LISTED = re.findall(r"^::: ([\w.]+)$", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)


def test_everything_public_is_listed():
    here = {name.removeprefix("cruise.") for name in LISTED if name.count(".") == 1}
    assert here == set(cruise.__all__) - {"__version__"}
    assert len(LISTED) == len(set(LISTED))


def test_everything_listed_is_there_and_says_what_it_is():
    for name in LISTED:
        place, _, last = name.rpartition(".")
        thing = getattr(importlib.import_module(place), last)
        assert thing.__doc__, name
