"""The picture of a race can be drawn of any race."""

import io

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cruise.evaluation.matches import make_match, run_races
from cruise.presets import TRACKS
from cruise.racing.events import EventKind
from cruise.report.figure_style import our_look
from cruise.report.race_figure import draw_race
from cruise.report.race_scene import make_scene
from tests.evaluation.pilots import TROUBLE
from tests.storage.logs import small_log

MISSES = np.full(4, EventKind.MISSED_GATE, np.int32)

# A race full of incidents, a race in which nothing happens, and many drones of few samples.
RACES = {
    "trouble": lambda: next(run_races(make_match(TRACKS["figure-eight"], 6, TROUBLE, laps=2), 10, 0)),
    "alone": lambda: small_log(
        drones=1,
        event_kind=np.array([EventKind.CROSSING] + [EventKind.MISSED_GATE] * 3, np.int32),
        event_drone=np.zeros(4, np.int32),
    ),
    "crowd": lambda: small_log(drones=16),
    "no events": lambda: small_log(event_kind=MISSES),
    "one sample": lambda: small_log(samples=1, event_kind=MISSES, airborne=np.zeros((1, 2), bool)),
}


@pytest.fixture(scope="module")
def trouble():
    return RACES["trouble"]()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", RACES)
def test_every_race_gives_a_picture(case):
    picture = matplotlib.image.imread(io.BytesIO(draw_race(RACES[case]())), format="png")
    assert picture.shape == (1045, 1650, 4)
    assert 0.02 < (picture[..., :3].min(axis=2) < 0.9).mean() < 0.5  # neither blank nor black


def test_the_same_race_gives_the_same_picture():
    assert draw_race(small_log()) == draw_race(small_log())


def test_progress_counts_gates_and_never_falls(trouble):
    scene = make_scene(trouble)
    assert (np.diff(scene.progress, axis=0) >= 0).all()
    for drone, times in enumerate(scene.crossings):
        for number, moment in enumerate(times[np.isfinite(times)], start=1):
            progress = np.interp(moment, trouble.time, scene.progress[:, drone])
            assert progress == pytest.approx(number, abs=0.1)


MARKUP = ("prize $\\frac{1$", "prize $5 vs $10", "a_b^c", "<b>&amp;</b>", "[red]x[/red]", ":cat:", "100 %", "\u540d")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", MARKUP)
def test_a_name_is_never_read_as_markup(name):
    assert len(draw_race(small_log(track=name, pilots=np.array([name, "b"])))) > 10_000


def test_dollars_are_letters():
    """Read as a formula the two would vanish."""
    with our_look():
        figure = Figure()
        renderer = FigureCanvasAgg(figure).get_renderer()
        widths = [figure.text(0, 0, text).get_window_extent(renderer).width for text in ("$5 vs $10", "05 vs 010")]
    assert widths[0] == pytest.approx(widths[1], abs=1.0)  # as wide as digits


HOSTILE = {"text.usetex": True, "font.size": 40.0, "axes.facecolor": "black", "lines.linewidth": 9.0, "savefig.dpi": 7}


def test_the_users_settings_of_matplotlib_do_not_reach_a_picture():
    expected = draw_race(small_log())
    with mpl.rc_context(HOSTILE):
        assert draw_race(small_log()) == expected
