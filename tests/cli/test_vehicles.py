"""`--vehicle`: what can be flown, what is refused, and what a vehicle decides about training."""

import pytest

from cruise.cli.main import main, parse
from cruise.config import Randomisation, TrainConfig
from cruise.presets import CURRICULA, RANDOMISATION, VEHICLES, training_config


@pytest.mark.parametrize("command", [["vehicles"], ["vehicles", "list"]])
def test_vehicles_are_listed_with_their_sources(command, capsys, monkeypatch):
    """In 80 columns, where no word is broken: the sources stand below the table."""
    monkeypatch.setenv("COLUMNS", "80")
    assert main(command) == 0
    output = capsys.readouterr().out
    rows = {line.split()[1]: line for line in output.splitlines() if line.startswith("\u2502")}
    assert list(rows) == list(VEHICLES)
    assert "3.30" in rows["racer"]
    assert "acceleration" in rows["paper"]
    for vehicle in VEHICLES.values():
        assert f"{vehicle.name}\n  {vehicle.source}\n" in output


@pytest.mark.parametrize("command", ["race --pilot chaser", "evaluate --pilot chaser", "train"])
def test_an_unknown_vehicle_is_refused_in_one_line(command, capsys):
    assert main([*command.split(), "--vehicle", "rcer"]) == 2
    error = capsys.readouterr().err
    known = "built-in vehicles: paper, racer, racer-5, crazyflie; or give a TOML file's path"
    assert error == f"error: unknown vehicle 'rcer': did you mean 'racer'? {known}\n"


def config_of(*flags):
    return parse(["train", *flags]).config


def test_the_vehicle_decides_the_defaults_of_training(capsys):
    assert config_of() == training_config("paper")
    assert config_of("--seed", "0", "--vehicle", "racer") == training_config("racer")
    assert config_of("--vehicle=crazyflie", "--seed", "0") == training_config("crazyflie")
    assert main(["train", "--vehicle", "racer", "--help"]) == 0
    assert "(default: body)" in " ".join(capsys.readouterr().out.split())


def test_the_number_of_drones_decides_how_boldly_they_learn(capsys):
    two, four = config_of("--drones", "2"), config_of("--drones=4")
    assert (two.drones, two.ppo.races, two.ppo.entropy_hold) == (2, 256, 0.5)
    assert four == TrainConfig()
    assert main(["train", "--drones", "two"]) == 2
    assert "two" in capsys.readouterr().err


@pytest.mark.parametrize(
    "flags",
    [
        "--drones=4 --drones 2",
        "--drones 4 --drones=2",
        "--drones +2",
        "--vehicle racer --vehicle=paper --drones=2",
        "--vehicle=racer --drones 1 --drones 2 --vehicle paper",
    ],
)
def test_the_last_of_a_flag_given_twice_decides_the_defaults_too(flags):
    assert config_of(*flags.split()) == config_of("--drones", "2")


def test_the_value_of_another_flag_decides_no_defaults():
    """Words that look like a flag but are a value; a flag with underscores, which the parser takes as well."""
    assert config_of("--start-from=--drones", "--seed", "2").ppo == training_config("paper").ppo
    assert config_of("--reward-preset", "paper", "--episodes", "2").ppo == training_config("paper").ppo


@pytest.mark.parametrize("name", VEHICLES)
def test_every_vehicle_has_a_curriculum(name):
    stages = CURRICULA[name]
    assert len(stages) == 5
    assert stages[-1].agility == pytest.approx(VEHICLES[name].agility)
    assert sum(stage.steps for stage in stages) >= 1_000_000
    assert training_config(name).vehicle == name


def test_randomise_is_a_share_of_what_is_full():
    def of(*flags):
        return config_of(*flags).randomisation

    full = RANDOMISATION["racer"]
    assert of("--vehicle", "racer", "--randomise", "1") == full
    assert of("--vehicle", "racer") == of("--vehicle", "racer", "--randomise=0.5") != full
    assert of("--vehicle", "racer", "--randomise", "0.5").clip_share == 1
    assert of("--vehicle", "racer", "--randomise", "0") == of("--randomise", "0") == Randomisation()
    assert of("--randomise", "1") == of("--randomise=0", "--randomise", "1") == RANDOMISATION["paper"]
