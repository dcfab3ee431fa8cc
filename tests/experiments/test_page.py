"""The page that a person wrote: its numbers are there, and what it says is so in the results that are kept."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import pytest

from experiments.claims import CLAIMS
from experiments.evidence import Evidence, read_evidence
from experiments.named import named
from experiments.page import PICTURE, Block, Content, read_blocks, to_page, to_text
from experiments.plan import Job, full_scale, make_plan
from experiments.report import make_content, rate_tracks, write_report
from experiments.results import ResultFolder
from tests.experiments.invented import invent

RESULTS = Path(__file__).parent.parent.parent / "results"
BLOCKS = read_blocks()
ASSERTING = [block for block in BLOCKS if block.asserts]


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return read_evidence(ResultFolder(RESULTS), full_scale())


@pytest.fixture(scope="module")
def content(evidence) -> Content:
    return make_content(evidence)


@pytest.fixture(scope="module")
def values(content) -> Mapping[str, str]:
    return content.values


@pytest.mark.parametrize("block", ASSERTING, ids=[block.text.split("**")[1] for block in ASSERTING])
def test_what_the_page_says_is_so(block, values):
    wrong = block.contradictions(values)
    assert not wrong, f"{'; '.join(wrong)}: rewrite in experiments/page.md, with what it asserts:\n{block.text}"


def test_every_number_is_there_and_every_claim_is_asserted_or_shown(values):
    names = [name for block in BLOCKS for name in block.names if not name.startswith("table.")]
    assert len(names) > 50
    for name in names:
        assert values[name] not in ("not run", "none"), name
    known = {f"check.{name}" for name in CLAIMS}
    asserted = {name for block in BLOCKS for name in block.asserts if name.startswith("check.")}
    assert all(any(name == check or name.startswith(f"{check}.") for check in known) for name in asserted)


def test_the_page_shows_every_table_and_figure_once(content):
    tables = [name.removeprefix("table.") for block in BLOCKS for name in block.names if name.startswith("table.")]
    pictures = [found[2] for block in BLOCKS if (found := PICTURE.fullmatch(block.text))]
    assert sorted(tables) == sorted(content.tables)
    assert sorted(pictures) == sorted(content.figures)


def test_kept_results_are_whole(content):
    assert content.warnings == ()


def test_text_that_results_contradict_is_marked(tmp_path):
    """Invented drones of CRUISE win where the kept ones do not."""
    folder, scale = ResultFolder(tmp_path), dataclasses.replace(full_scale(), races=6)
    invent(folder, scale, tuple(job for job in make_plan(scale) if job.kind != "vanilla-stage5"))
    found = read_evidence(folder, scale)
    values = named(found, rate_tracks(found))
    wins = next(block for block in BLOCKS if block.text.startswith("**Who wins"))
    assert wins.filled(values).startswith("**Not so in these results (rated.first.ring is CRUISE, not VANILLA; ")


def test_a_study_of_one_track_says_so_of_the_other(tmp_path):
    scale = dataclasses.replace(full_scale(), races=6, tracks=("ring",))
    page = write_report(read_evidence(ResultFolder(tmp_path / "none"), scale), tmp_path / "report").read_text()
    assert "ring: the paper&#x27;s table" in page
    assert "figure-eight: the paper&#x27;s table" not in page
    assert "Not run: no part of this study." in page


def test_results_that_are_not_there_make_a_text_unknown_not_wrong(tmp_path):
    folder, scale = ResultFolder(tmp_path), dataclasses.replace(full_scale(), races=6)
    invent(folder, scale, (Job("cruise", "ring", 4, 0),))
    found = read_evidence(folder, scale)
    values = named(found, rate_tracks(found))
    for block in BLOCKS:
        if any(name.startswith("compare.") for name in block.asserts):
            assert "**Not known from these results.**" in block.filled(values)


TEXT = """# A <title>

Lead with `code` and **bold**.

## One & two

<!-- a = yes; b.c = not told apart -->
- It is ${n} & more,
  in two lines.

- Next.

*A note.*

![A <picture>](figures/none.svg)
"""
CONTENT = Content({"a": "yes", "b.c": "not told apart", "n": "3 < 4"}, {}, {}, ("Mind <this>.",))


def test_blocks_become_a_page_and_markdown():
    blocks = read_blocks(TEXT)
    assert blocks[3] == Block("- It is ${n} & more,\n  in two lines.", {"a": "yes", "b.c": "not told apart"})
    page = to_page(blocks, CONTENT)
    assert "<h1>A &lt;title&gt;</h1>" in page
    assert "<p class='warning'>Mind &lt;this&gt;.</p>" in page
    assert "<p>Lead with <code>code</code> and <strong>bold</strong>.</p>" in page
    assert "<a href='#one-two'>One &amp; two</a>" in page
    assert "<ul>\n<li>It is 3 &lt; 4 &amp; more,\n  in two lines.</li>\n<li>Next.</li>\n</ul>" in page
    assert "<p class='note'>A note.</p>" in page
    assert "<picture>" not in page
    text = to_text(blocks, CONTENT)
    assert text.startswith("# A <title>\n\n> Mind <this>.\n\nLead")
    assert "- It is 3 < 4 & more," in text
    assert "<!--" not in text


def test_a_name_that_there_is_not_is_no_page():
    with pytest.raises(KeyError, match="nowhere"):
        to_page(read_blocks(TEXT.replace("${n}", "${nowhere}")), CONTENT)
