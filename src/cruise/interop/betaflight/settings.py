"""What the firmware is set to: lines of its command line, computed from a vehicle or taken from a real drone."""

import math
import os
import re
from collections.abc import Sequence
from typing import NamedTuple

from cruise.config import Firmware, Vehicle
from cruise.errors import CruiseError
from cruise.interop.flight_controller import airframe_of
from cruise.vehicles.named import name_of

PTERM = 0.032029  # of the firmware: P by degrees a second is thousandths of a motor's range
ITERM = 0.244381  # likewise of I, by degrees
PID_RANGE = 1000.0
HIGHEST_P = 250
INTEGRATION = 1.0  # s in which I makes up for an error as P does at once: slow beside a turn, so that little winds up
RATE_UNIT = 10.0  # of rc_rate and srate [deg/s]
AXES = ("roll", "pitch", "yaw")


class Setting(NamedTuple):
    """One line for the firmware's command line."""

    line: str
    why: str


# What the simulator's own link needs, and no real drone.
BENCH = (
    Setting("feature -GPS", "there is none"),
    Setting("feature -TELEMETRY", "there is none"),
    Setting("set motor_pwm_protocol = PWM", "the only one that this build has"),
    Setting("set small_angle = 180", "arm however it stands"),
    Setting("set pwr_on_arm_grace = 0", "no wait for a person to step back"),
    Setting("set failsafe_delay = 200", "races are not ended by it"),
    Setting("map AETR1234", "order of the channels"),
    Setting("aux 0 0 0 1700 2100 0 0", "the first switch arms"),
)


def link(vehicle: Vehicle) -> tuple[Setting, ...]:
    """What the sticks mean: any drone needs it whose sticks a policy moves."""
    rates = {axis: round(math.degrees(rate) / RATE_UNIT) for axis, rate in zip(AXES, full_rates(vehicle), strict=True)}
    straight = [
        Setting("set rates_type = ACTUAL", "a stick says a rate"),
        *(Setting(f"set {axis}_rc_rate = {unit}", "linear: the middle is as steep") for axis, unit in rates.items()),
        *(Setting(f"set {axis}_srate = {unit}", f"{unit * 10} deg/s at full stick") for axis, unit in rates.items()),
        *(Setting(f"set {axis}_expo = 0", "linear") for axis in AXES),
        Setting("set thr_mid = 50", "linear"),
        Setting("set thr_expo = 0", "linear"),
    ]
    return (
        Setting("feature AIRMODE", "rates are held at low thrust, too"),
        Setting("set airmode_start_throttle_percent = 0", "from the first moment"),
        Setting("set deadband = 0", "small commands count"),
        Setting("set yaw_deadband = 0", "likewise"),
        *straight,
    )


def matched(vehicle: Vehicle) -> tuple[Setting, ...]:
    """Gains with which the firmware's rate loop is the vehicle's: tau = J (omega_c - omega) / t.

    One unit of P and one degree a second are `PTERM` thousandths of the range of every motor, which is its thrust; so
    P = 1000 / PTERM x (pi / 180) x J / (t x 4 x lever x f), with f the range of one rotor's thrust.
    """
    plain = (
        ("simplified_pids_mode = OFF", "the gains below count"),
        ("throttle_boost = 0", "thrust is what was asked for"),
        ("anti_gravity_gain = 0", "no extra I when the thrust changes"),
        ("tpa_rate = 0", "the same loop at every thrust"),
        ("feedforward_yaw_hold_gain = 0", "no feed-forward: a step is a step"),
        ("thrust_linear = 0", "the thrust curve is not the firmware's matter"),
    )
    lines = [Setting(f"set {line}", why) for line, why in plain]
    for axis, gain in zip(AXES, matched_p(vehicle), strict=True):
        lines += [
            Setting(f"set p_{axis} = {gain}", "J / (t x 4 x lever x thrust of a rotor)"),
            Setting(
                f"set i_{axis} = {matched_i(vehicle, gain)}",
                "the vehicle's own, or small: it winds up where rotors saturate",
            ),
            Setting(f"set d_{axis} = 0", "rotors are fast enough without"),
            Setting(f"set d_max_{axis} = 0", "likewise"),
            Setting(f"set f_{axis} = 0", "no feed-forward"),
        ]
    idle = round(10_000 * vehicle_idle(vehicle))
    return (*lines, Setting(f"set motor_idle = {idle}", "the vehicle's least thrust [0.01 %]"))


def matched_p(vehicle: Vehicle) -> tuple[int, ...]:
    """P of roll, pitch and yaw, as `matched` says."""
    airframe = airframe_of(vehicle)
    rotors = airframe.rotors
    forward, sideways = rotors.offset
    strength = 4 * airframe.rates.time_constant * (rotors.max_thrust - rotors.min_thrust)
    levers = (sideways, forward, rotors.torque_ratio)
    unit = PID_RANGE / PTERM * math.pi / 180
    gains = (unit * inertia / (strength * lever) for inertia, lever in zip(vehicle.inertia, levers, strict=True))
    return tuple(min(max(1, round(gain)), HIGHEST_P) for gain in gains)


def usual_known(vehicle: Vehicle) -> dict[str, float]:
    """What the link must know of a firmware that is set as `matched` says."""
    p = matched_p(vehicle)[2]
    return {
        "motor_idle": 10_000 * vehicle_idle(vehicle),
        "min_check": 1050.0,
        "p_yaw": p,
        "i_yaw": matched_i(vehicle, p),
        "iterm_windup": 80.0,
        "pidsum_limit_yaw": 400.0,
    }


def matched_i(vehicle: Vehicle, p: int) -> int:
    """I beside a P: the integral of the vehicle's rate loop; a slow one where it has none, as drones differ in fact."""
    gain = airframe_of(vehicle).rates.integral_gain or 1 / INTEGRATION
    return max(1, round(p * PTERM * gain / ITERM))


def vehicle_idle(vehicle: Vehicle) -> float:
    """Of a motor's range, what the least thrust is."""
    rotors = airframe_of(vehicle).rotors
    return rotors.min_thrust / rotors.max_thrust


def full_rates(vehicle: Vehicle) -> tuple[float, float, float]:
    """Rates at full stick [rad/s]: what the vehicle may be asked for, rounded up; yaw has room for `StickMap`.

    Raises CruiseError beyond what the firmware can.
    """
    roll, pitch, yaw = (math.ceil(math.degrees(one) / RATE_UNIT - 1e-6) for one in airframe_of(vehicle).rates.highest)
    units = (roll, pitch, max(roll, pitch, yaw))
    if max(units) > 100:
        raise CruiseError(f"betaflight turns at 1000 deg/s at most, and {vehicle.name!r} at {RATE_UNIT * max(units):g}")
    full = tuple(math.radians(RATE_UNIT * unit) for unit in units)
    return full[0], full[1], full[2]


def lines_for(vehicle: Vehicle, firmware: Firmware) -> tuple[str, ...]:
    """All lines for the firmware in the loop, in order; what comes later counts.

    Raises:
        CruiseError: the vehicle has no rotors or turns faster than the firmware can.
    """
    own = [one.line for one in matched(vehicle)] if firmware.settings == "matched" and not firmware.cli else []
    after = [one.line for one in (*link(vehicle), *BENCH)]
    return ("defaults nosave", *firmware.cli, "rateprofile 0", *own, *after)


MEANT = re.compile(r"(set [a-z0-9_]+ = [ -~]{1,80}|profile [0-3]|rateprofile [0-5]|feature -?[A-Z0-9_]+)")
MOST_LINES = 5000


def read_cli(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """The lines of a real drone's `diff all` that say how it flies; ports, timers and names are left out.

    Raises:
        CruiseError: it cannot be read, or is nothing of the kind.
    """
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            text = file.read(1_000_000)
    except OSError as error:
        raise CruiseError(f"cannot read {os.fspath(path)!r}: {error.strerror}") from None
    lines = [line.strip() for line in text.splitlines()]
    meant = tuple(line for line in lines if MEANT.fullmatch(line))
    if not any(line.startswith("set ") for line in meant) or len(meant) > MOST_LINES:
        raise CruiseError(f"{os.fspath(path)!r} is no output of `diff all`: no line says `set NAME = VALUE`")
    return meant


def text_of(settings: Sequence[Setting]) -> str:
    """For people to read and to paste: what stands behind # means nothing to the firmware."""
    return "\n".join(f"# {one.why}\n{one.line}" for one in settings)


def vehicle_text(vehicle: Vehicle) -> str:
    """All that a pilot pastes into his drone so that it flies as the vehicle does."""
    return f"# CRUISE: {name_of(vehicle)}\n{text_of((*link(vehicle), *matched(vehicle)))}\nsave"
