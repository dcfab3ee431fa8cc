"""A vehicle of one's own: it races, is trained for and is remembered, and no file of the package knows it."""

from dataclasses import replace
from pathlib import Path

import pytest

import cruise
from cruise.adapters.options import RaceOptions, choose
from cruise.cli.main import parse
from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match
from cruise.pilots.scripted import Chaser
from cruise.presets import REWARDS, TRACKS, VEHICLES, full_randomisation, training_config
from cruise.storage.config_file import load_config, save_config
from cruise.storage.policy_file import read_meta, shipped_name
from cruise.training.curriculum import plan_phases
from cruise.training.session import CONFIG, Session, resume_config
from cruise.training.validation import check_config, owning_vehicle
from tests.storage.policies import write_policy
from tests.training.runs import TINY
from tests.vehicles.tables import HEAVY

RING = TRACKS["ring"]


@pytest.fixture
def heavy_file(tmp_path: Path) -> Path:
    path = tmp_path / "heavy.toml"
    path.write_text(HEAVY)
    return path


def test_whoever_takes_a_vehicle_takes_a_file_a_name_and_an_object(heavy_file):
    heavy = cruise.load_vehicle(heavy_file)
    for choice in (heavy, heavy_file, str(heavy_file)):
        match = make_match(RING, 2, ["chaser", "hover"], vehicle=choice)
        assert match.vehicle == heavy
        assert {pilot.vehicle for pilot in match.team} == {heavy}
        chosen = choose(RaceOptions(drones=1, vehicle=choice, observation="body"), everybody_learns=False)
        assert (chosen.vehicle, chosen.agility) == (heavy, (heavy.agility,))
    assert make_match(RING, 1, "chaser", vehicle="racer").team[0].vehicle == "racer"


def test_a_policy_of_a_racer_flies_a_heavier_one_where_that_is_asked(heavy_file):
    heavy = cruise.load_vehicle(heavy_file)
    log = cruise.race("ring", 1, "racer-ring", laps=1, seed=3, vehicle=heavy_file)
    assert log.vehicle == "heavy"
    assert log.time[-1] < 12.0
    aboard = make_match(RING, 1, "racer-ring", vehicle=heavy)
    assert aboard.vehicle == heavy
    assert aboard.team[0].agility == VEHICLES["racer"].agility  # the scale that it was trained with
    with pytest.raises(CruiseError, match="'ring-4' was made for vehicle 'paper', this race flies 'heavy', whose"):
        make_match(RING, 4, "ring-4", vehicle=heavy)
    with pytest.raises(CruiseError, match="was made for vehicle 'racer', this race flies 'racer', whose actions mean"):
        make_match(RING, 1, "racer-ring", vehicle=replace(VEHICLES["racer"], control="attitude"))
    with pytest.raises(CruiseError, match="pilots of different vehicles cannot race each other: heavy, racer; say"):
        make_match(RING, 2, ["racer-ring", Chaser().for_vehicle(heavy)])
    assert make_match(RING, 2, ["racer-ring", Chaser(vehicle=VEHICLES["racer"])]).vehicle == VEHICLES["racer"]
    with pytest.raises(CruiseError, match="no policy is shipped for track 'ring' with 1 drone and vehicle 'heavy'"):
        shipped_name("ring", 1, heavy)
    with pytest.raises(CruiseError, match="or train one: cruise train --vehicle kolibri --track ring --drones 2"):
        shipped_name("ring", 2, "kolibri")


def test_a_policy_carries_its_vehicle(heavy_file, tmp_path):
    heavy = cruise.load_vehicle(heavy_file)
    write_policy(tmp_path / "own", vehicle=heavy)
    heavy_file.unlink()
    assert read_meta(tmp_path / "own").vehicle == heavy
    assert make_match(RING, 2, str(tmp_path / "own")).vehicle == heavy


def test_the_vehicle_in_a_policy_is_checked(heavy_file, tmp_path):
    stem = tmp_path / "own"
    write_policy(stem, vehicle=cruise.load_vehicle(heavy_file))
    sound = stem.with_suffix(".json").read_text()
    for old, new, message in (
        ('"mass": 1.0', '"mass": -1.0', "vehicle 'heavy': mass must be positive, not -1.0"),
        ('"mass": 1.0', '"mas": 1.0', "unknown key 'mas'"),
        ('"mass": 1.0', '"mass": "1"', "policy.vehicle.mass: expected a number, got '1'"),
    ):
        assert old in sound
        stem.with_suffix(".json").write_text(sound.replace(old, new, 1))
        with pytest.raises(CruiseError) as caught:
            read_meta(stem)
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_vehicle_of_a_file_is_trained_as_what_it_is_flown_by(heavy_file):
    heavy = cruise.load_vehicle(heavy_file)
    chosen = parse(["train", "--vehicle", str(heavy_file)]).config
    assert chosen == training_config(heavy)
    assert chosen == replace(training_config("racer"), vehicle=heavy)
    assert chosen.reward == REWARDS["agile"]
    check_config(chosen)
    assert plan_phases(chosen)[-1].stage.agility == heavy.agility
    assert full_randomisation(heavy) == full_randomisation(VEHICLES["racer"])
    slow = replace(VEHICLES["paper"], name="slow", mass=2.0)
    assert training_config(slow, 2) == replace(training_config("paper", 2), vehicle=slow)
    assert not full_randomisation(slow).mass_spread


def test_a_run_owns_its_vehicle(heavy_file, tmp_path):
    """Its numbers are in the run and in its policies, whatever becomes of the file."""
    heavy = cruise.load_vehicle(heavy_file)
    config = owning_vehicle(
        replace(
            TINY, vehicle=str(heavy_file), observation="body", opponents=replace(TINY.opponents, sparring_share=0.0)
        )
    )
    assert config.vehicle == heavy
    heavy_file.write_text(HEAVY.replace("1.0", "1.2"))
    session = Session(tmp_path / "run", config, RING, heavy)
    assert session.trainer.env.vehicle == heavy
    policy = session._write_policy("policy", session.trainer.phases[-1], {})
    assert read_meta(policy).vehicle == heavy
    assert make_match(RING, 1, str(policy)).vehicle == heavy
    assert resume_config(tmp_path / "run") == config
    assert '"mass": 1.0' in (tmp_path / "run" / CONFIG).read_text()


def test_a_configuration_of_a_preset_names_it(tmp_path):
    path = tmp_path / "config.json"
    save_config(path, owning_vehicle(TrainConfig(vehicle="racer")))
    assert '"vehicle": "racer"' in path.read_text()
    assert load_config(path, TrainConfig).vehicle == "racer"
    path.write_text('{"vehicle": 3}')
    with pytest.raises(CruiseError, match="vehicle: expected a vehicle's name or its numbers, got 3"):
        load_config(path, TrainConfig)
