"""`--vehicle`: what can be flown, what is refused, and what a vehicle decides about training."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cruise.cli.main import main, parse
from cruise.config import Drag, Randomisation, TrainConfig
from cruise.presets import CURRICULA, RANDOMISATION, VEHICLES, training_config
from cruise.report.vehicle_figure import rate_answer
from cruise.training.validation import check_config
from cruise.vehicles import load_vehicle
from cruise.vehicles.derived import top_speed
from cruise.vehicles.guess import Measured, guessed_vehicle
from tests.vehicles.tables import HEAVY, MALFORMED


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
    known = f"built-in vehicles: {', '.join(VEHICLES)}; or give a TOML file's path"
    assert error == f"error: unknown vehicle 'rcer': did you mean 'racer'? {known}\n"


def config_of(*flags):
    return parse(["train", *flags]).config


def test_the_vehicle_decides_the_defaults_of_training(capsys):
    assert config_of() == training_config("paper")
    assert config_of("--seed", "0", "--vehicle", "racer") == training_config("racer")
    assert config_of("--vehicle=crazyflie", "--seed", "0") == training_config("crazyflie")
    assert main(["train", "--vehicle", "racer", "--help"]) == 0
    assert "(default: racing-near)" in " ".join(capsys.readouterr().out.split())


def test_where_others_fly_one_drone_learns():
    """All learn where all fly the newest policy. Beside older ones, or with a memory, one does, from as many races."""
    of_racer = functools.partial(config_of, "--vehicle", "racer", "--drones")
    assert (of_racer("4").learners, of_racer("4").ppo.races) == (4, 128)
    assert (of_racer("8").learners, of_racer("8").ppo.races) == (8, 64)
    for flags in (("--league", "4"), ("--against", "racer-ring"), ("--network", "gru")):
        config = of_racer("4", *flags)
        assert (config.learners, config.ppo.races, config.opponents.learners) == (1, 512, "one")
        check_config(config)
    assert [of_racer(str(n)).ppo.races for n in (2, 3, 5, 6, 7, 16)] == [256, 128, 64, 64, 64, 64]  # cores share them
    assert config_of("--drones", "4").learners == 1


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


def test_a_policy_to_start_from_decides_what_the_networks_see():
    def seen(*flags):
        config = config_of("--vehicle", "racer", "--drones", "1", *flags)
        return config.observation, config.critic_observation

    before = ("--start-from", "racer-figure-eight")
    assert seen() == ("racing", "racing-far")
    assert seen(*before) == ("body", "")
    assert seen(*before, "--critic-observation", "body-far") == ("body", "body-far")
    assert seen(*before, "--observation", "racing") == ("racing", "")
    assert seen("--against", "racer-figure-eight") == seen("--founders", "racer-figure-eight") == ("body", "")
    assert seen("--demonstrations", "flights") == ("racing", "")


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


@pytest.mark.parametrize("case", MALFORMED)
def test_check_names_every_fault_on_its_own_line(case, tmp_path, capsys):
    content, expected = MALFORMED[case]
    path = tmp_path / "vehicle.toml"
    path.write_text(content)
    assert main(["vehicles", "check", str(path)]) == 1
    output = capsys.readouterr()
    assert output.out == ""
    lines = output.err.splitlines()
    assert len(lines) == len(expected)
    assert all(line.startswith(f"{path}: {text}") for line, text in zip(lines, expected, strict=True))
    assert main(["vehicles", "show", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {lines[0]}")


def test_several_files_are_checked_at_once(tmp_path, capsys):
    sound, faulty = tmp_path / "heavy.toml", tmp_path / "faulty.toml"
    sound.write_text(HEAVY)
    faulty.write_text(HEAVY.replace("1.0", "0"))
    assert main(["vehicles", "check", str(sound), str(faulty), "racer"]) == 1
    output = capsys.readouterr()
    assert output.err == f"{faulty}: mass_kg must be greater than 0, got 0\n"
    assert output.out.splitlines()[0] == (
        f"{sound}: no faults; heavy: 1 kg, told ctbr at 50 Hz, lifts 2.48 times its weight"
    )
    assert main(["vehicles", "check", str(tmp_path / "none.toml"), str(sound)]) == 2
    output = capsys.readouterr()
    assert output.err == f"error: {tmp_path / 'none.toml'}: no such vehicle file\n"
    assert "no faults" in output.out
    assert main(["vehicles", "check"]) == 2


def test_a_new_file_is_sound_and_says_what_is_guessed(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    flags = ["--mass", "0.6", "--arm", "0.11", "--propeller", "0.1", "--thrust", "6"]
    assert main(["vehicles", "new", "mine.toml", *flags]) == 0
    assert "lifts 4.08 times its weight" in capsys.readouterr().out
    mine = load_vehicle("mine.toml")
    assert (mine.name, mine.mass, mine.airframe.rotors.max_thrust) == ("mine", 0.6, 6.0)
    assert math.hypot(*mine.airframe.rotors.offset) == pytest.approx(0.11, rel=0.01)
    text = Path("mine.toml").read_text()
    assert text.count("# guess") >= 8
    assert main(["vehicles", "new", "mine.toml"]) == 2
    assert "mine.toml is there already: choose another name" in capsys.readouterr().err
    assert Path("mine.toml").read_text() == text


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ("x.toml --mass -1", "--mass must be greater than 0, got -1.0"),
        ("x.toml --arm nan", "--arm must be finite, got nan"),
        ("x.toml --mass 5 --thrust 1", "vehicle 'x': agility (0.8), the highest thrust per mass, must exceed gravity"),
        ("x.json", "x.json: a vehicle file ends in .toml"),
        ("racer.toml", "racer.toml: 'racer' is a built-in vehicle: choose another name"),
        ("none/x.toml", "none/x.toml: cannot be written: No such file or directory"),
    ],
)
def test_a_new_file_that_cannot_be_is_refused(flags, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["vehicles", "new", *flags.split()]) == 2
    assert capsys.readouterr().err.startswith(f"error: {message}")
    assert not list(tmp_path.iterdir())


def test_a_guess_is_of_the_order_of_what_was_measured():
    """Told only what a ruler and scales say of the two vehicles that were measured, it finds the rest within a half."""
    for name, propeller in (("racer", 0.127), ("crazyflie", 0.0462)):
        real = VEHICLES[name]
        rotors = real.airframe.rotors
        known = Measured(real.mass, math.hypot(*rotors.offset), propeller, rotors.max_thrust)
        guess = guessed_vehicle("guess", known)
        for found, measured in (
            *zip(guess.inertia, real.inertia, strict=True),
            (guess.airframe.rotors.torque_ratio, rotors.torque_ratio),
            (guess.airframe.drag.horizontal, real.airframe.drag.horizontal),
            (guess.airframe.drag.vertical, real.airframe.drag.vertical),
        ):
            assert 1 / 1.5 < found / measured < 1.5


def test_what_is_shown_can_be_saved_and_says_what_follows(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["vehicles", "show", "crazyflie"]) == 0
    text, _, figures = capsys.readouterr().out.partition("\n\n\u250f")
    path = tmp_path / "again.toml"
    path.write_text(text)
    assert load_vehicle(path) == VEHICLES["crazyflie"]
    for shown in ("thrust to weight", "2.33", "0.06867 N", "top speed", "collective_thrust", "22.81 m/s^2"):
        assert shown in figures
    assert main(["vehicles", "show", "paper"]) == 0
    assert "acceleration_x" in capsys.readouterr().out


def test_top_speed_is_where_drag_takes_the_thrust():
    vehicle = VEHICLES["racer"]
    speed = top_speed(vehicle)
    level = math.sqrt(vehicle.agility**2 - vehicle.gravity**2)
    assert vehicle.airframe.drag.horizontal * speed == pytest.approx(vehicle.mass * level)
    rough = replace(vehicle, airframe=replace(vehicle.airframe, drag=Drag(horizontal=0.2, quadratic=0.01)))
    speed = top_speed(rough)
    assert 0.2 * speed + 0.01 * speed**2 == pytest.approx(vehicle.mass * level)


def test_a_vehicle_is_drawn(tmp_path, capsys):
    out = tmp_path / "racer.png"
    assert main(["vehicles", "show", "racer", "--png", str(out)]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(["vehicles", "show", "paper", "--png", str(tmp_path / "paper.png")]) == 2
    assert "vehicle 'paper' has no rotors to draw: leave out --png" in capsys.readouterr().err
    assert not (tmp_path / "paper.png").exists()


@pytest.mark.parametrize(("loop", "lag"), [(0.03, 0.04), (0.04, 0.01), (0.02, 0.0)])
def test_the_drawn_answer_solves_its_equation(loop, lag):
    """t T w'' + t w' + w = 1 from rest, by differences."""
    time = np.linspace(0.0, 1.0, 10_001)
    rate = rate_answer(time, loop, lag)
    speed = np.gradient(rate, time)
    np.testing.assert_allclose(
        loop * lag * np.gradient(speed, time)[2:-2] + (loop * speed + rate)[2:-2], 1.0, atol=1e-3
    )
    assert (rate[0], rate[-1]) == pytest.approx((0.0, 1.0), abs=1e-3)
