"""Results on disk: whole, strict, and told in one line where they are not sound."""

import dataclasses
import json

import pytest

from cruise.errors import CruiseError
from experiments.evidence import job_of, read_evidence
from experiments.plan import Job, full_scale
from experiments.results import ResultFolder
from tests.experiments.invented import invent, invent_cell, invent_meetings

SCALE = dataclasses.replace(full_scale(2), races=6)
CELL = Job("cruise", "figure-eight", 3, 1)
PLANNER = Job("se-ibr-tuned", "ring", 2, 0)
DUELS = Job("head-to-head", "ring", 2, 0)


@pytest.fixture
def folder(tmp_path) -> ResultFolder:
    found = ResultFolder(tmp_path)
    invent(found, SCALE, (CELL, PLANNER, DUELS))
    return found


def test_what_is_written_is_read(folder):
    assert folder.read(CELL) == invent_cell(CELL, SCALE)
    assert folder.read(PLANNER) == invent_cell(PLANNER, SCALE)
    assert folder.read(DUELS) == invent_meetings(DUELS, SCALE)
    assert folder.read(Job("cruise", "ring", 2, 0)) is None


@pytest.mark.parametrize("job", [CELL, PLANNER, DUELS])
def test_a_files_name_tells_its_job(folder, job):
    assert job_of(folder.file_of(job)) == job


def test_one_line_per_field(folder):
    lines = folder.file_of(CELL).read_text().splitlines()
    assert lines[0] == "{"
    assert lines[-1] == "}"
    assert len(lines) == 2 + len(dataclasses.fields(invent_cell(CELL, SCALE)))


def broken(text: str, path: str, value: object) -> str:
    """The JSON with one entry replaced; `path` as keys and indices joined by dots."""
    data = json.loads(text)
    *way, last = [int(key) if key.isdecimal() else key for key in path.split(".")]
    place = data
    for key in way:
        place = place[key]
    if value is None:
        del place[last]
    else:
        place[last] = value
    return json.dumps(data)


FAULTS = {
    "no key": (CELL, "measured", None, "measured: missing"),
    "another key": (CELL, "mesured", 1, "unknown key 'mesured'"),
    "text": (CELL, "measured.success.2", "all", "measured.success[2]: expected a number, got 'all'"),
    "format": (CELL, "format", 9, "format 9, this program reads 1"),
    "another job": (CELL, "drones", 4, "holds another job than its name says: figure-eight-4-cruise-s1"),
    "short list": (CELL, "measured.lap", [1.0], "expected one number per race in every list, got success 6"),
    "share": (CELL, "measured.success.0", 100, "success must be a share from 0 to 1"),
    "short stage": (CELL, "stages.1.measured.lap", [], "expected one number per race in every list"),
    "no races": (DUELS, "meetings.0.rank", [], "cruise against vanilla: rank, finish and crashed must have one entry"),
    "no entrant": (DUELS, "meetings.0.rank.3", [1], "every race must have one entry per entrant"),
    "no entrants": (DUELS, "meetings.0.entrants", ["cruise", "mallory"], "unknown entrant 'mallory'"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_file_that_is_not_sound(folder, case):
    job, path, value, message = FAULTS[case]
    file = folder.file_of(job)
    file.write_text(broken(file.read_text(), path, value))
    with pytest.raises(CruiseError) as error:
        read_evidence(folder, SCALE)
    assert str(error.value).startswith(f"result {file}: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", ["", "{", "[]", "\0\xff", '{"format": NaN}'])
def test_what_is_no_json_object(folder, content):
    folder.file_of(CELL).write_text(content)
    with pytest.raises(CruiseError, match=r"^result .*: "):
        read_evidence(folder, SCALE)


@pytest.mark.parametrize(
    "name", ["notes", "ring-4-cruse-s0", "rnig-4-cruise-s0", "ring-x-cruise-s0", "ring-4-cruise-s"]
)
def test_a_name_that_is_none(folder, name):
    (folder.path / "cells" / f"{name}.json").write_text("{}")
    with pytest.raises(CruiseError, match=r"its name is not TRACK-DRONES-KIND-sSEED\.json"):
        read_evidence(folder, SCALE)


def test_quick_results_do_not_mix_with_full_ones(folder):
    quick = dataclasses.replace(SCALE, name="quick")
    with pytest.raises(CruiseError, match=r"holds a result of the full study .* this is the quick one"):
        read_evidence(folder, quick)


def test_evidence_is_grouped_in_order_of_seeds(tmp_path):
    folder = ResultFolder(tmp_path)
    jobs = [Job("cruise", "ring", 2, seed) for seed in (10, 2, 0)]
    invent(folder, SCALE, tuple(jobs))
    cells = read_evidence(folder, SCALE).of("cruise", "ring", 2)
    assert [cell.seed for cell in cells] == [0, 2, 10]
