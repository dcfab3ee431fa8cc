"""From a place through balls: the problem of Foehn, Romero and Scaramuzza, and what every such flight must satisfy."""

import functools

import numpy as np
import pytest

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.limit.lap import Options, find_limit
from cruise.limit.log import limit_log
from cruise.limit.models import POSITION, RATES, VELOCITY
from cruise.limit.transcription import Dash
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.race_log import EventKind
from cruise.vehicles import find_vehicle

TRACK, START, RADIUS, PUBLISHED = TRACKS["split-s"], (-5.0, 4.5, 1.2), 0.3, 17.56


@functools.cache
def dash(stop=False):
    """Half as many steps as usual: some seconds."""
    return find_limit(TRACK, find_vehicle("cpc"), Options(dash=Dash(START, 20, stop), ball=RADIUS, steps=10))


def test_the_published_optimum():
    """17.56 s to a stop at the end, in steps of one length, one of which ends within every ball; ours are free."""
    to_a_stop = dash(stop=True).lap
    assert to_a_stop.time == pytest.approx(PUBLISHED, rel=0.01)
    assert 0.97 * to_a_stop.time < dash().lap.time < to_a_stop.time
    np.testing.assert_allclose(to_a_stop.state[-1, POSITION], TRACK.gates[19 % 7].position_w, atol=1e-6)
    np.testing.assert_allclose(to_a_stop.state[-1, VELOCITY], 0.0, atol=1e-6)


def test_every_gate_is_passed_within_its_ball_in_order_from_rest():
    lap, highest = dash().lap, find_vehicle("cpc").airframe.rates.highest
    np.testing.assert_allclose(lap.state[0, POSITION], START, atol=1e-6)
    np.testing.assert_allclose(lap.state[0, VELOCITY], 0.0, atol=1e-6)
    assert len(lap.duration) == 20
    for number in range(20):
        centre = TRACK.gates[number % 7].position_w
        assert np.linalg.norm(lap.state[(number + 1) * lap.steps, POSITION] - centre) <= RADIUS + 1e-4
    assert (np.abs(lap.state[:, RATES]) <= np.array(highest) + 1e-4).all()
    assert dash().lap_times == (lap.time,)
    assert dash().frames_struck == ()


def test_its_log_begins_where_it_does():
    log = limit_log(dash())
    crossings = log.event_time[log.event_kind == EventKind.CROSSING]
    np.testing.assert_allclose(crossings, np.cumsum(dash().lap.duration))
    np.testing.assert_allclose(log.position_w[0, 0], START, atol=1e-6)
    assert (log.event_gate[:8].tolist(), log.next_gate[0, 0]) == ([0, 1, 2, 3, 4, 5, 6, 0], 0)


@pytest.mark.parametrize(
    ("vehicle", "options", "message"),
    [
        ("racer", Options(ball=0.0), "the radius of balls must be above 0, not 0.0"),
        ("racer", Options(dash=Dash((0.0, 0.0, 99.0), 3)), "a dash must start within the bounds of split-s"),
        ("racer", Options(dash=Dash(START, 0)), "a dash is through 1 to 60 gates, not 0"),
        ("racer", Options(dash=Dash(START, 3), standing_laps=1), "laps from standing or a dash from a place"),
        ("paper", Options(ball=0.3), "a dash and balls are known for vehicles with rotors, and 'paper' has none"),
    ],
)
def test_what_no_dash_can_be_is_said_in_one_line(vehicle, options, message):
    with pytest.raises(CruiseError, match=message):
        find_limit(TRACK, VEHICLES[vehicle], options)


def test_flags_that_do_not_go_together(capsys):
    assert main(["limit", "split-s", "--gates", "3"]) == 2
    assert "--gates is about the flight from --start X Y Z: give both" in capsys.readouterr().err
    assert main(["limit", "split-s", "--start", "0", "0", "1", "--laps", "2"]) == 2
    assert "--start X Y Z is flown once" in capsys.readouterr().err
