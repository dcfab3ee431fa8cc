"""PX4 over MAVLink 2: body rates and thrust by SET_ATTITUDE_TARGET in offboard mode, which the pilot chooses."""

from typing import Any

from cruise.companion.link import Heard, LinkLost
from cruise.dynamics.attitude import Setpoint
from cruise.extras import import_extra

COMPANION = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
IGNORE_ATTITUDE = 128  # of ATTITUDE_TARGET_TYPEMASK
OFFBOARD = 6  # PX4's main mode, third byte of the custom mode
ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
ARM_DISARM, EVEN_IN_FLIGHT = 400, 21196
HEARTBEAT = 1.0  # between two of ours [s]
LEVEL = (1.0, 0.0, 0.0, 0.0)


class MavlinkLink:
    """See `cruise.companion.link.Link`. Frames: PX4's body is x forward, y right, z down."""

    def __init__(self, address: str, top: float, baud: int = 921600) -> None:
        """Open `udpin:127.0.0.1:14540`, a serial device, or what else pymavlink knows.

        Args:
            address: of the autopilot.
            top: thrust per mass that the autopilot's full thrust is [m/s^2].
            baud: of a serial device.

        Raises:
            LinkLost: it cannot be opened.
            CruiseError: pymavlink is not installed.
        """
        mavutil = import_extra("pymavlink.mavutil", "companion", "MAVLink needs pymavlink")
        self._top, self._beat, self._now = top, -HEARTBEAT, 0.0
        self._heard: Heard | None = None
        try:
            self._to: Any = mavutil.mavlink_connection(
                address, baud=baud, dialect="common", source_system=1, source_component=COMPANION
            )
        except (OSError, ValueError) as error:
            raise LinkLost(f"{address}: {error}") from None

    def poll(self, now: float) -> Heard | None:
        """As `Link.poll`."""
        self._now = now
        try:
            while (message := self._to.recv_match(blocking=False)) is not None:
                if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1:
                    mode = message.custom_mode >> 16 & 0xFF
                    self._heard = Heard(now, bool(message.base_mode & ARMED), mode == OFFBOARD)
            if now - self._beat >= HEARTBEAT:
                self._beat = now
                self._to.mav.heartbeat_send(18, 8, 0, 0, 4)  # an onboard controller, no autopilot, active
        except OSError as error:
            raise LinkLost(str(error)) from None
        return self._heard

    def command(self, asked: Setpoint, yaw_rate: float, armed: bool) -> None:
        """As `Link.command`."""
        del yaw_rate, armed  # arming is not this message's matter
        p, q, r = (float(rate) for rate in asked.rates_b)
        thrust = min(max(float(asked.thrust) / self._top, 0.0), 1.0)
        when = int(self._now * 1000) & 0xFFFFFFFF
        self._send("set_attitude_target_send", when, 1, 1, IGNORE_ATTITUDE, LEVEL, p, -q, -r, thrust)

    def stand_by(self) -> None:
        """As `Link.stand_by`: without a stream of targets the autopilot enters no offboard mode."""

    def disarm(self) -> None:
        """As `Link.disarm`."""
        self._send("command_long_send", 1, 1, ARM_DISARM, 0, 0.0, float(EVEN_IN_FLIGHT), 0.0, 0.0, 0.0, 0.0, 0.0)

    def close(self) -> None:
        """As `Link.close`."""
        self._to.close()

    def _send(self, name: str, *values: Any) -> None:
        try:
            getattr(self._to.mav, name)(*values)
        except OSError as error:
            raise LinkLost(str(error)) from None
