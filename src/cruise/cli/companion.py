"""`cruise companion POLICY.onnx`: a policy on the computer aboard a drone."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from cruise.cli.line_up import described
from cruise.cli.outputs import check_output
from cruise.errors import CruiseError
from cruise.extras import import_extra

if TYPE_CHECKING:
    from cruise.companion.link import Link
    from cruise.companion.policy import OnnxPolicy

BAUD = 921_600


@dataclass(frozen=True)
class Drone:
    """What the flight controller was set to; defaults are those of `cruise betaflight settings`."""

    motor_idle: float = 0.0
    """As its `motor_idle` [0.01 %]."""
    min_check: float = 1050.0
    """As its `min_check` [us]."""
    p_yaw: float = 0.0
    """As its `p_yaw`; 0: as the settings say."""
    i_yaw: float = -1.0
    """As its `i_yaw`; -1: as the settings say."""


@dataclass(frozen=True)
class CompanionProgram:
    """Fly a drone by a policy from the computer aboard. Only a person arms, and hands over. Verified on no hardware."""

    policy: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="POLICY.onnx")]
    """A policy as `cruise export --onnx` writes it."""
    track: Annotated[str, described("NAME|FILE")]
    """The gates where they really stand: a built-in track, or path of a TOML file."""
    link: Annotated[str, described("DEVICE|ADDRESS")]
    """The flight controller: a serial device or udp:HOST:PORT (msp), or what pymavlink opens, as
    udpin:127.0.0.1:14540 (mavlink)."""
    fence: Annotated[tuple[float, float, float, float, float, float], described("X Y Z X Y Z")]
    """Lowest and highest corner of the geofence [m]."""
    protocol: Literal["msp", "mavlink"] = "msp"
    """msp: sticks to Betaflight. mavlink: body rates and thrust to PX4."""
    odometry_port: int = 5601
    """UDP port of the loopback on which the estimator's datagrams come."""
    baud: int = BAUD
    """Of a serial device."""
    log: Path = Path("flight.npz")
    """Where to write the flight: a race log as any other."""
    drone: Drone = field(default_factory=Drone)

    def run(self) -> int:
        """Wait for a person, fly, write the log; exit code 0 where a person ended the flight, else 1."""
        check_output("--log", self.log, ".npz")
        from cruise.companion.flight import Companion, Limits  # noqa: PLC0415  (imports JAX)
        from cruise.companion.flight_log import log_of  # noqa: PLC0415
        from cruise.companion.odometry import Receiver  # noqa: PLC0415
        from cruise.companion.policy import OnnxPolicy  # noqa: PLC0415
        from cruise.companion.run import run  # noqa: PLC0415
        from cruise.racing.track_file import load_track  # noqa: PLC0415

        low, high = self.fence[:3], self.fence[3:]
        if not all(a < b for a, b in zip(low, high, strict=True)):
            raise CruiseError(f"--fence: its lowest corner {low} must be below its highest {high}")
        policy = OnnxPolicy(self.policy, load_track(self.track))
        receiver = Receiver(self.odometry_port)
        companion = Companion(policy, self._opened(policy), Limits(low, high), time.monotonic)
        print(f"odometry on 127.0.0.1:{receiver.port}; waiting for a person to arm and to hand over", flush=True)
        ended = run(companion, receiver)
        print(f"flight ended: {ended}; {receiver.refused} datagrams refused {receiver.last_fault}".rstrip())
        if companion.samples:
            log_of(companion.samples, policy).save(self.log)
            print(f"log      {self.log}")
        return 0 if ended in ("a person took over", "Ctrl-C") else 1

    def _opened(self, policy: "OnnxPolicy") -> "Link":
        from cruise.companion.link import LinkLost  # noqa: PLC0415
        from cruise.companion.mavlink import MavlinkLink  # noqa: PLC0415
        from cruise.companion.msp import MspLink, UdpPort  # noqa: PLC0415
        from cruise.interop.betaflight.settings import usual_known  # noqa: PLC0415
        from cruise.interop.betaflight.sticks import StickMap  # noqa: PLC0415

        drone = {name: getattr(self.drone, name) for name in ("motor_idle", "min_check")}
        drone |= {"p_yaw": self.drone.p_yaw} if self.drone.p_yaw > 0 else {}
        drone |= {"i_yaw": self.drone.i_yaw} if self.drone.i_yaw >= 0 else {}
        sticks = StickMap.of(policy.vehicle, usual_known(policy.vehicle) | drone)
        try:
            if self.protocol == "mavlink":
                return MavlinkLink(self.link, sticks.top, self.baud)
            if self.link.startswith("udp:"):
                return MspLink(UdpPort(self.link.removeprefix("udp:")), sticks)
            serial = import_extra("serial", "companion", "MSP over a serial line needs pyserial")
            return MspLink(serial.Serial(self.link, self.baud, timeout=0, write_timeout=0.05), sticks)
        except (LinkLost, OSError, ValueError) as error:
            raise CruiseError(f"--link {self.link}: cannot be opened: {error}") from None
