"""The ways to a flight controller: what is said on the wire, and what happens where nobody answers."""

import os
import socket
import struct
import threading
import time
import tty

import numpy as np
import pytest
import serial
from pymavlink import mavutil

from cruise.cli.main import main
from cruise.companion.flight import Companion, Limits
from cruise.companion.link import Heard, LinkLost
from cruise.companion.mavlink import ARM_DISARM, IGNORE_ATTITUDE, OFFBOARD, MavlinkLink
from cruise.companion.msp import Decoder, MspLink, UdpPort, checksum, message
from cruise.companion.odometry import Odometry, Receiver
from cruise.companion.run import run
from cruise.dynamics.attitude import Setpoint
from cruise.errors import CruiseError
from tests.companion.aboard import STICKS, Hover

WIDE = Limits((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0))


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def heard_within(link, seconds=3.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        heard = link.poll(time.monotonic())
        if heard is not None:
            return heard
        time.sleep(0.01)
    return None


def test_mavlink_says_rates_and_thrust_and_never_arms():
    """Against a peer on the loopback: PX4's body is x forward, y right, z down."""
    port = free_port()
    link = MavlinkLink(f"udpin:127.0.0.1:{port}", top=32.0)
    autopilot = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", dialect="common", source_system=1)
    autopilot.mav.srcComponent = 1
    autopilot.mav.heartbeat_send(2, 12, 128, OFFBOARD << 16, 4)
    heard = heard_within(link)
    assert heard is not None
    assert (heard.armed, heard.engaged) == (True, True)
    link.command(Setpoint(16.0, (1.0, 2.0, 3.0)), 0.0, armed=True)
    link.stand_by()
    link.disarm()
    said = []
    end = time.monotonic() + 3.0
    while time.monotonic() < end and "COMMAND_LONG" not in [one.get_type() for one in said]:
        one = autopilot.recv_match(blocking=True, timeout=0.1)
        said += [one] if one is not None else []
    target = next(one for one in said if one.get_type() == "SET_ATTITUDE_TARGET")
    rates = (target.body_roll_rate, target.body_pitch_rate, target.body_yaw_rate)
    np.testing.assert_allclose(rates, (1.0, -2.0, -3.0))
    assert target.thrust == pytest.approx(0.5)
    assert target.type_mask == IGNORE_ATTITUDE
    commands = [one for one in said if one.get_type() == "COMMAND_LONG"]
    assert [(one.command, one.param1) for one in commands] == [(ARM_DISARM, 0.0)]
    link.close()
    autopilot.close()


def test_msp_is_read_whatever_way_it_is_cut_and_damage_is_left_out():
    body = bytes([2, 101, 7, 9])
    whole = b"$M>" + body + bytes([checksum(body)])
    broken = whole[:-1] + b"\x00"
    for size in (1, 3, 100):
        decoder, stream = Decoder(), b"noise$M" + whole + broken + whole
        found = [one for at in range(0, len(stream), size) for one in decoder.feed(stream[at : at + size])]
        assert found == [(101, b"\x07\x09")] * 2
    assert message(200, b"\x01\x02") == b"$M<\x02\xc8\x01\x02" + bytes([2 ^ 200 ^ 1 ^ 2])


def test_a_cable_that_comes_off_is_told():
    master, slave = os.openpty()
    tty.setraw(slave)
    link = MspLink(serial.Serial(os.ttyname(slave), timeout=0, write_timeout=0.05), STICKS)
    os.close(slave)
    link.poll(0.0)
    os.close(master)
    with pytest.raises(LinkLost):
        _ = [link.poll(0.0) for _ in range(5)]
    link.close()


def test_msp_goes_over_udp_as_over_a_cable():
    """A flight controller on the loopback that says it is armed and handed over; then it is gone."""
    controller = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    controller.bind(("127.0.0.1", 0))
    controller.settimeout(3.0)
    link = MspLink(UdpPort(f"127.0.0.1:{controller.getsockname()[1]}"), STICKS)
    assert link.poll(0.0) is None
    asked, companion = controller.recvfrom(100)
    assert asked == message(119)
    for code, payload in ((119, bytes([0, 50])), (101, struct.pack("<HHHI", 0, 0, 0, 3))):
        body = bytes([len(payload), code]) + payload
        controller.sendto(b"$M>" + body + bytes([checksum(body)]), companion)
    assert heard_within(link)[1:] == (True, True)
    link.command(Setpoint(9.81, (0.0, 0.0, 0.0)), 0.0, armed=True)
    said = []
    while not said or said[-1][4] != 200:
        said.append(controller.recv(100))
    assert struct.unpack_from("<4H", said[-1], 5)[:2] == (1500, 1500)
    controller.close()
    with pytest.raises(LinkLost):
        _ = [link.poll(0.0) for _ in range(5)]
    link.close()
    for wrong in ("127.0.0.1", "127.0.0.1:0", ":5000"):
        with pytest.raises(ValueError, match="udp:HOST:PORT"):
            UdpPort(wrong)


class Deaf:
    """A flight controller that is armed and handed over, and keeps what it is told."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def poll(self, now):
        return Heard(now, True, True)

    def command(self, asked, yaw_rate, armed):
        self.said.append("command")

    def stand_by(self):
        self.said.append("stand by")

    def disarm(self):
        self.said.append("disarm")

    def close(self):
        self.said.append("close")


def test_a_program_that_hangs_is_stopped_by_its_watchdog():
    """The policy hangs for half a second of real time: the motors stop meanwhile, from beside it."""
    link, policy, receiver = Deaf(), Hover(), Receiver(0)
    asked, told, stopped = Hover.act, [], []

    def act(state):
        if len(told) == 3:
            began = time.monotonic()
            while time.monotonic() < began + 10 and "disarm" not in link.said:
                time.sleep(0.005)
            stopped.append(time.monotonic() - began)
        told.append(state)
        return asked(policy, state)

    policy.act = act
    level = Odometry(0.0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    receiver.poll = lambda now: level._replace(time=now)
    companion = Companion(policy, link, WIDE, time.monotonic)
    thread = threading.Thread(target=run, args=(companion, receiver))
    thread.start()
    thread.join(30)
    assert not thread.is_alive()
    assert "the program did not answer" in companion.ended
    assert link.said.index("disarm") == 3
    assert stopped[0] < 5  # some hundredths on a machine that is free
    assert set(link.said[3:-1]) == {"disarm"}  # nothing is commanded afterwards


def test_what_cannot_be_opened_is_one_line(tmp_path, capsys):
    taken = Receiver(0)
    with pytest.raises(CruiseError, match=f"cannot listen for odometry on UDP port {taken.port}: .* choose another"):
        Receiver(taken.port)
    taken.close()
    flags = ["companion", str(tmp_path / "none.onnx"), "--track", "ring", "--link", "/dev/none"]
    assert main([*flags, "--fence", "0", "0", "0", "1", "1", "0"]) == 2
    assert "--fence: its lowest corner" in capsys.readouterr().err
    assert main([*flags, "--fence", "0", "0", "0", "1", "1", "1"]) == 2
    error = capsys.readouterr().err
    assert "none.onnx" in error
    assert error.count("\n") == 1
