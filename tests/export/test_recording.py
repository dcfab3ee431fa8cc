"""What exports are compared with is flight: it agrees with the environment, and holds what can go wrong."""

import numpy as np
import pytest

from tests.export.conftest import AGILE, KINDS


def test_drones_left_the_air_and_passed_gates(exporters):
    inputs = exporters("shipped").recording.inputs
    assert len(inputs["position_w"]) > 5000
    assert set(inputs["next_gate"].tolist()) == set(range(5))
    here = inputs["others_airborne"]
    assert (~here).any()
    assert here.mean() > 0.5
    assert np.abs(inputs["euler"]).max() > 0.2


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in (*AGILE, "told")])
def test_the_velocity_that_an_action_asks_for_is_nearly_flown(kind, exporters):
    """The commanded acceleration is that of the paper's controller, written out."""
    recording = exporters(kind).recording
    action, before = recording.outputs["action"], recording.inputs["previous_action"]
    error, error_before = 7.5 * 0.1 * action, 7.5 * 0.1 * before
    desired = 0.42 * error + 2.0 * (error - error_before)
    wanted = 5.0 * desired - 0.05 * recording.inputs["velocity_w"]
    np.testing.assert_allclose(recording.outputs["acceleration_w"], wanted, atol=1e-4)


@pytest.mark.parametrize("kind", AGILE)
def test_what_an_agile_action_commands(kind, exporters):
    """Written out for the racer: 3.3 times its weight, 10, 10 and 3 rad/s; what hovers comes before the first."""
    recording = exporters(kind).recording
    action = recording.outputs["action"]
    np.testing.assert_allclose(recording.outputs["thrust"], 3.3 * 9.81 * (action[:, 0] + 1) / 2, atol=1e-4)
    np.testing.assert_allclose(recording.outputs["body_rates_b"], action[:, 1:] * (10, 10, 3), atol=1e-5)
    np.testing.assert_allclose(recording.inputs["previous_action"][0], (2 / 3.3 - 1, 0, 0, 0), atol=1e-6)
    assert np.abs(action - recording.inputs["previous_action"]).max() > 0.1


def test_others_go_around_from_the_next_in_number(exporters):
    """Rows of one moment of one race: the first other of each drone is the next drone."""
    inputs = exporters("shipped").recording.inputs
    position, others = inputs["position_w"][:4], inputs["others_position_w"][:4]  # all four stand at the start
    for drone in range(4):
        for k in range(3):
            np.testing.assert_array_equal(others[drone, k], position[(drone + 1 + k) % 4])
