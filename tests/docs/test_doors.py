"""The table of one race through every door: every option, at the doors that have it."""

import dataclasses
import inspect
import re

import pytest

import cruise
from cruise.adapters.options import RaceOptions
from cruise.cli.main import main
from tests.docs.blocks import ROOT

PAGE = (ROOT / "docs" / "clients.md").read_text().partition("## Each client")[0]
ROWS = re.findall(r"^\| `?([a-z_]+)`? \|(.*)\|$", PAGE, re.MULTILINE)
TABLE = {name: [cell.strip() for cell in cells.split("|")] for name, cells in ROWS if cells.count("|") == 3}
RACE, PYTHON, OPTION, TRAIN = range(4)


def words(column, pattern):
    return {word for name, cells in TABLE.items() if name != "option" for word in re.findall(pattern, cells[column])}


def test_every_option_has_a_row():
    assert set(TABLE) - {"option", "seed"} == {field.name for field in dataclasses.fields(RaceOptions)}
    assert all(f"`{name}`" in cells[OPTION] for name, cells in TABLE.items() if name not in ("option", "seed"))


def test_python_has_what_the_table_says():
    told = words(PYTHON, r"`([a-z_]+)`")
    for door in (cruise.race, cruise.evaluate):
        assert told <= set(inspect.signature(door).parameters)
    asked = {"episodes"} | told
    assert set(inspect.signature(cruise.evaluate).parameters) == asked


@pytest.mark.parametrize(("command", "column"), [("race", RACE), ("evaluate", RACE), ("train", TRAIN)])
def test_commands_have_what_the_table_says(command, column, capsys):
    assert main([command, "--help"]) == 0
    told = capsys.readouterr().out
    for flag in words(column, r"`(--[a-z-]+)`"):
        assert flag in told, flag
