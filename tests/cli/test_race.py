"""`cruise race`: a result table, a picture, a replay, a log; and nothing but one line where something is wrong."""

import numpy as np
import pytest

from cruise.cli.line_up import LineUp
from cruise.cli.main import main
from cruise.evaluation.metrics import race_result
from cruise.storage import policy_paths
from cruise.storage.race_log import load_race_log
from tests.storage.policies import write_policy


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")


def test_race_writes_table_picture_and_log(tmp_path, capsys):
    flags = ["--pilot", "chaser", "--pilot", "hover", "--laps", "1", "--seed", "3"]
    assert main(["race", *flags, "--log", "out/race.npz"]) == 0
    output = capsys.readouterr()
    assert (tmp_path / "race.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "race.html").read_bytes().startswith(b"<!doctype html>")
    log = load_race_log("out/race.npz")
    drones = race_result(log).drones
    assert log.pilots.tolist() == ["chaser", "hover"]
    assert f"{drones[0].finish_time:.2f} s" in output.out
    assert "finished" in output.out
    assert "time limit" in output.out
    assert output.err == ""

    assert main(["race", *flags, "--png", "None", "--html", "None", "--log", "again.npz"]) == 0
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "out" / "race.npz").read_bytes()
    assert not list(tmp_path.glob("None*"))


def test_several_races_share_a_page_and_have_logs_of_their_own(tmp_path, capsys):
    flags = ["--pilot", "chaser", "--pilot", "hover", "--laps", "1", "--png", "None", "--races", "2"]
    assert main(["race", *flags, "--log", "race.npz"]) == 0
    assert (tmp_path / "race.html").read_bytes().count(b'"label":"race ') == 2
    logs = [load_race_log(f"race-{k}.npz") for k in (1, 2)]
    assert not np.array_equal(logs[0].position_w[0], logs[1].position_w[0])
    written = capsys.readouterr().out
    assert all(f"{min(drone.finish_time for drone in race_result(log).drones):.2f} s" in written for log in logs)
    assert not (tmp_path / "race.png").exists()


def test_track_and_drones_come_from_the_policy(tmp_path, capsys):
    write_policy(tmp_path / "run" / "policy", track="figure-eight", drones=2, name="duellist")
    assert main(["race", "--policy", "run", "--laps", "1", "--png", "None", "--log", "race.npz"]) == 0
    log = load_race_log("race.npz")
    assert (log.track, log.num_drones, log.pilots.tolist()) == ("figure-eight", 2, ["duellist"] * 2)
    assert "duellist" in capsys.readouterr().out


BAD = {
    "policy and pilot": (["--policy", "chaser", "--pilot", "hover"], "--policy flies every drone and --pilot one"),
    "no such policy": (["--policy", "ace"], "policy 'ace' not found"),
    "no such pilot": (["--pilot", "chaser", "--pilot", "ace"], "policy 'ace' not found"),
    "no such track": (["--track", "rink", "--pilot", "chaser"], "unknown track 'rink': did you mean 'ring'?"),
    "nothing shipped": (["--drones", "7"], "no policy is shipped for track 'ring' with 7 drones"),
    "no drones": (["--pilot", "chaser", "--drones", "0"], "drones must be from 1 to 64, got 0"),
    "no laps": (["--pilot", "chaser", "--laps", "0"], "laps must be from 1 to 100, got 0"),
    "negative seed": (["--pilot", "chaser", "--seed", "-1"], "seed must be from 0 to"),
    "picture of another kind": (["--pilot", "chaser", "--png", "race.jpg"], "--png must name a .png file"),
    "log of another kind": (["--pilot", "chaser", "--log", "race.csv"], "--log must name a .npz file"),
    "page of another kind": (["--pilot", "chaser", "--html", "race.htm"], "--html must name a .html file"),
    "nothing to open": (["--pilot", "chaser", "--html", "None", "--open"], "--open shows the replay"),
    "no races": (["--pilot", "chaser", "--races", "0"], "--races must be from 1 to 1000, got 0"),
    "log is a folder": (["--pilot", "chaser", "--log", "folder.npz"], "--log folder.npz is a folder"),
    "for other drones": (["--policy", "duel", "--drones", "3"], "was trained for races of 2 drones, this race has 3"),
    "damaged policy": (["--policy", "damaged"], "not a whole safetensors file"),
    "half a policy": (["--policy", "half"], "policy description half.json does not exist"),
    "own track": (
        ["--policy", "far"],
        "policy 'far' was trained on track 'moon', not a built-in one: give its --track",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_flags_give_one_line_and_no_files(case, tmp_path, monkeypatch, capsys):
    flags, message = BAD[case]
    monkeypatch.setattr(policy_paths, "SHIPPED", tmp_path / "none")
    (tmp_path / "folder.npz").mkdir()
    write_policy(tmp_path / "duel")
    write_policy(tmp_path / "damaged").write_bytes(b"damaged")
    write_policy(tmp_path / "half").with_suffix(".json").unlink()
    write_policy(tmp_path / "far", name="far")
    far = tmp_path / "far.json"
    far.write_text(far.read_text().replace('"ring"', '"moon"'))
    before = sorted(tmp_path.rglob("*"))
    assert main(["race", *flags]) == 2
    output = capsys.readouterr()
    assert output.err.startswith("error: ")
    assert message in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""
    assert sorted(tmp_path.rglob("*")) == before


def test_nothing_is_written_where_the_log_cannot_be(tmp_path, capsys):
    (tmp_path / "file").write_bytes(b"")
    flags = ["--pilot", "chaser", "--pilot", "hover", "--laps", "1"]
    assert main(["race", *flags, "--log", "file/race.npz"]) == 2
    assert capsys.readouterr().err.startswith("error: cannot write file/race.npz: ")
    assert not (tmp_path / "race.png").exists()


def test_help_names_every_flag(capsys):
    assert main(["race", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(
        f"--{flag}" in text
        for flag in ("track", "drones", "policy", "pilot", "laps", "seed", "races", "png", "html", "log")
    )
    assert np.max([len(line) for line in text.splitlines()]) <= 120


@pytest.mark.parametrize(
    ("pilots", "flags", "names"),
    [
        (("racer-ring", "chaser"), {}, ["racer-ring", "chaser"]),  # sees a field of any size
        (("racer-ring", "chaser"), {"drones": 3}, ["racer-ring", "chaser", "racer-ring"]),
        (("racer-ring",), {}, ["racer-ring"] * 8),
        (("ring-3", "chaser"), {}, ["ring-3", "chaser", "ring-3"]),  # flies in races of three alone
        (("chaser", "hover"), {}, ["chaser", "hover"]),
        (("chaser",), {}, ["chaser"] * 4),
    ],
)
def test_how_many_race_where_nobody_says(pilots, flags, names):
    assert [pilot.name for pilot in LineUp(pilot=pilots, **flags).match().team] == names
