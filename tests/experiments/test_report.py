"""The report of a result set: every figure in it is printed data, a limit, or follows from the results."""

import csv
import dataclasses
import io
import re
from pathlib import Path

import pytest

from experiments.claims import claims_table
from experiments.entries import NOT_RUN
from experiments.evidence import Evidence, read_evidence
from experiments.named import named
from experiments.page import read_blocks
from experiments.plan import Job, full_scale, make_plan, quick_scale
from experiments.printed import TABLES
from experiments.report import rate_tracks, warnings, write_report
from experiments.results import CELLS, ResultFolder
from experiments.table import Number, Table, to_csv, to_html, to_markdown
from experiments.tables import all_tables, performance_table
from tests.experiments import invented
from tests.experiments.invented import invent

SCALE = dataclasses.replace(full_scale(), races=6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> ResultFolder:
    found = ResultFolder(tmp_path_factory.mktemp("results"))
    invent(found, SCALE)
    return found


@pytest.fixture(scope="module")
def evidence(folder) -> Evidence:
    return read_evidence(folder, SCALE)


@pytest.fixture(scope="module")
def tables(evidence) -> dict[str, Table]:
    return {table.name: table for table in all_tables(evidence, rate_tracks(evidence))}


@pytest.fixture(scope="module")
def written(evidence, tmp_path_factory) -> Path:
    return write_report(evidence, tmp_path_factory.mktemp("report")).parent


def test_every_printed_figure_stands_beside_the_measured_one(tables, evidence):
    for (track, kind, drones), printed in TABLES.items():
        summary = evidence.summary(kind, track, drones)
        names = ("lap printed [s]", "speed printed [m/s]", "success printed [%]", "mean speed [m/s]")
        rows = [
            dict(zip(tables[f"performance-{track}"].header, row, strict=True))
            for row in tables[f"performance-{track}"].rows
        ]
        titles = {"cruise": "CRUISE", "se-ibr": "SE-IBR, paper's caps", "vanilla": "VANILLA"}
        row = next(r for r in rows if r["drones"] == str(drones) and r["pilot"] == titles[kind])
        shown = "N/A" if printed.lap is None else f"{printed.lap:.1f} ± {printed.lap_std:.1f}"
        assert row[names[0]] == shown
        assert row[names[2]] == f"{printed.success:g}"
        assert (row[names[3]].mean, row[names[3]].low) == (summary.speed.mean, summary.speed.low)


def test_every_cell_of_a_whole_study_is_filled(tables):
    for table in tables.values():
        assert not any(entry == NOT_RUN for row in table.rows for entry in row), table.name
        assert all(len(row) == len(table.header) for row in table.rows)


def test_a_missing_cell_says_not_run(tmp_path):
    folder = ResultFolder(tmp_path)
    invent(folder, SCALE, (Job("cruise", "ring", 2, 0),))
    evidence = read_evidence(folder, SCALE)
    assert (
        f"{len(make_plan(SCALE)) - 1} of {len(make_plan(SCALE))} planned results are not there yet"
        in warnings(evidence)[0]
    )
    table = performance_table(evidence, "ring")
    cruise, planner = (
        next(row for row in table.rows if row[:2] == ("2", p)) for p in ("CRUISE", "SE-IBR, paper's caps")
    )
    assert isinstance(cruise[6], Number)
    assert planner[3:5] == (NOT_RUN, NOT_RUN)
    values = named(evidence, rate_tracks(evidence))
    lead = [block for block in read_blocks() if "?**" in block.text]
    assert len(lead) == 3
    assert all("**Not known from these results.**" in block.filled(values) for block in lead)


def test_nothing_at_all(tmp_path):
    path = write_report(read_evidence(ResultFolder(tmp_path / "none"), SCALE), tmp_path / "report")
    assert "not run" in path.read_text()
    assert "no race of four has been kept" in path.read_text()


def test_a_quick_run_says_so_on_every_table(tmp_path, monkeypatch):
    monkeypatch.setattr(invented, "ORIGIN", dataclasses.replace(invented.ORIGIN, scale="quick"))
    folder, scale = ResultFolder(tmp_path), quick_scale()
    invent(folder, scale)
    evidence = read_evidence(folder, scale)
    for table in all_tables(evidence, rate_tracks(evidence)):
        if table.name == "trials":  # single trainings of the full length
            continue
        assert "Quick run: 0.8 M training steps instead of 40 M, 10 races, one seed." in table.note, table.name


def test_the_page_needs_no_other_file(written):
    page = (written / "report.html").read_text()
    sources = re.findall(r"(?:src|href)=['\"]([^'\"]*)", page)
    assert sources
    assert all(source.startswith(("data:image/svg+xml;base64,", "#")) for source in sources)
    assert "<script" not in page
    assert page.count("<img ") == page.count("alt=") == len(list((written / "figures").iterdir()))


def test_the_same_results_give_the_same_report_byte_for_byte(written, evidence, tmp_path):
    again = write_report(evidence, tmp_path).parent
    files = [path.relative_to(written) for path in written.rglob("*") if path.is_file()]
    assert len(files) > 15
    for file in files:
        assert (again / file).read_bytes() == (written / file).read_bytes(), file


def test_markdown_holds_the_same_tables_and_every_figure(written, tables):
    text = (written / "report.md").read_text()
    for table in tables.values():
        assert to_markdown(table).rstrip() in text
    for link in re.findall(r"\]\(([^)]*\.svg)\)", text):
        assert (written / link).read_text().startswith("<?xml")


def test_csv_holds_the_numbers_of_the_tables(written, tables):
    for name, table in tables.items():
        rows = list(csv.DictReader(io.StringIO((written / "tables" / f"{name}.csv").read_text())))
        assert len(rows) == len(table.rows)
        for row, entries in zip(rows, table.rows, strict=True):
            for title, entry in zip(table.header, entries, strict=True):
                if isinstance(entry, Number) and entry.value != "-":
                    assert float(row[title]) == pytest.approx(entry.mean, rel=1e-5)


def compared(tmp_path, monkeypatch, **levels) -> dict[str, str]:
    """What the page says where these kinds succeed and fly otherwise."""
    monkeypatch.setattr(invented, "LEVELS", invented.LEVELS | levels)
    folder = ResultFolder(tmp_path)
    kinds = ("cruise", "self-play-only", "curriculum-only", "head-to-head")
    invent(folder, SCALE, tuple(job for job in make_plan(SCALE) if job.kind in kinds and job.drones in (2, 4)))
    evidence = read_evidence(folder, SCALE)
    return named(evidence, rate_tracks(evidence))


def test_comparisons_follow_the_numbers(tmp_path, monkeypatch):
    ways = {"better": ((1.0, 4.5), (0.1, 3.0)), "worse": ((0.1, 3.0), (1.0, 4.5)), "same": ((0.5, 4.0), (0.5, 4.0))}
    told = {"better": ("higher", "lower"), "worse": ("lower", "higher"), "same": ("not told apart", None)}
    first = {"better": "CRUISE", "worse": "SE-IBR, tuned"}
    for way, (cruise, other) in ways.items():
        levels = {"cruise": cruise, "self-play-only": other, "curriculum-only": other}
        values = compared(tmp_path / way, monkeypatch, **levels)
        success, lap = told[way]
        for kind in ("self-play-only", "curriculum-only"):
            assert values[f"compare.{kind}.success.ring"] == success
            assert lap is None or values[f"compare.{kind}.lap.ring"] == lap
        assert way == "same" or values["rated.first.ring"] == first[way]


def test_claims_are_decided_by_the_numbers(tmp_path, monkeypatch):
    def holds(folder, **levels):
        monkeypatch.setattr(invented, "LEVELS", invented.LEVELS | levels)
        invent(ResultFolder(folder), SCALE, tuple(j for j in make_plan(SCALE) if j.family in ("learned", "planner")))
        return {row[0]: row[3] for row in claims_table(read_evidence(ResultFolder(folder), SCALE)).rows}

    good = holds(tmp_path / "good", cruise=(1.0, 5.0), vanilla=(0.0, 2.0))
    assert set(good.values()) == {"yes"} or good["Speed grows with every stage"] != "no"
    bad = holds(tmp_path / "bad", cruise=(0.5, 2.0), vanilla=(1.0, 4.0))
    assert bad["CRUISE's mean speed, six cells"] == "no"
    assert bad["CRUISE is faster than SE-IBR, paper's caps"] == "no"
    assert bad["VANILLA fails on the ring with three drones or more"] == "no"


@pytest.mark.parametrize(("level", "holds"), [((1.0, 4.5), "yes"), ((0.1, 3.0), "no")])
def test_duels_are_claims_of_their_own(level, holds, tmp_path, monkeypatch):
    monkeypatch.setattr(invented, "LEVELS", invented.LEVELS | {"cruise": level})
    invent(ResultFolder(tmp_path), SCALE, tuple(job for job in make_plan(SCALE) if job.drones == 2))
    evidence = read_evidence(ResultFolder(tmp_path), SCALE)
    rows = {row[0]: row[3] for row in claims_table(evidence).rows}
    for kind in ("VANILLA", "SE-IBR, paper's caps", "SE-IBR, tuned"):
        assert rows[f"CRUISE wins its duels with {kind}"] == holds
    won, finished = (named(evidence, {})[f"{what}.cruise.vanilla.ring"] for what in ("duel", "survival"))
    assert float(won.split()[0]) <= float(finished.split()[0])


def test_settings_that_differ_between_seeds_are_told(tmp_path):
    folder = ResultFolder(tmp_path)
    jobs = (Job("cruise", "ring", 2, 0), Job("cruise", "ring", 2, 1), Job("cruise", "ring", 4, 0))  # 2 learn boldly
    invent(folder, SCALE, jobs)
    assert not any("different settings" in w for w in warnings(read_evidence(folder, SCALE)))
    path = folder.path / CELLS / f"{jobs[1].name}.json"
    without = path.read_text().replace('"vary_field": false', '"unknown_then": 0')  # from before this option
    assert without != path.read_text()
    path.write_text(without)
    assert not any("different settings" in w for w in warnings(read_evidence(folder, SCALE)))
    path.write_text(without.replace('"gamma": 0.99', '"gamma": 0.9'))
    assert any("CRUISE were made with different" in w for w in warnings(read_evidence(folder, SCALE)))


def test_tables_escape_what_they_are_given():
    table = Table("x", "a <b>", ("a|b", "c"), (("<i>|", Number(1.0, 0.5, 1.5, 1)), ("", Number(float("nan")))), "1 < 2")
    assert "<b>" not in to_html(table)
    assert "<i>" not in to_html(table)
    assert "a\\|b" in to_markdown(table)
    assert "| 1.0 (0.5 to 1.5) |" in to_markdown(table)
    assert to_csv(table).splitlines() == ["a|b,c,c low,c high", "<i>|,1,0.5,1.5", ",,,"]
