"""A drone in simulated time: plant, flight controller behind a pseudo-terminal, estimator, a person, a companion."""

import json
import os
import select
import socket
import struct
import tty
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import serial

from cruise.companion.flight import Companion, Limits
from cruise.companion.msp import MspLink, checksum
from cruise.companion.odometry import Receiver
from cruise.config import Firmware
from cruise.dynamics.attitude import Setpoint
from cruise.dynamics.quadrotor import FlightController, make_quadrotor
from cruise.dynamics.rotors import Demand, wrench_of
from cruise.interop.betaflight.configure import configured
from cruise.interop.betaflight.fleet import IN_OUR_ORDER
from cruise.interop.betaflight.process import Process
from cruise.interop.betaflight.settings import lines_for, usual_known
from cruise.interop.betaflight.sticks import StickMap
from cruise.presets import VEHICLES
from tests.interop.fake_firmware import motors as fake_motors

RACER = VEHICLES["racer"]
STICKS = StickMap.of(RACER, usual_known(RACER))
OVERRIDE = ("set msp_override_channels_mask = 31", "aux 1 50 1 1700 2100 0 0")
DT = 1e-3
ROTORS = RACER.airframe.rotors


def _told(flight, body, wrench, asked, memory):
    made = wrench_of(ROTORS, [ROTORS.max_thrust * one.clip(0.0, 1.0) for one in memory])
    return Demand(made.collective_thrust, tuple(made.body_torque_b)), memory


PLANT = make_quadrotor(
    replace(RACER, control_dt=DT, substeps=1),
    FlightController(_told, lambda vehicle, parameters, zero: jnp.zeros((4, *zero.shape))),
)
STEP = jax.jit(lambda state, motors: PLANT.step(_with(state, motors), jnp.zeros(4), RACER.agility))


def _with(state, motors):
    return state._replace(memory=state.memory._replace(controller=motors))


class RealController:
    """The firmware, its first port bridged from TCP to a pseudo-terminal."""

    def __init__(self) -> None:
        self.process = Process.start(configured((*lines_for(RACER, Firmware()), *OVERRIDE)).folder, uart=True)
        for _ in range(200):
            self.process.run(10 * DT)
        self.line = socket.create_connection(("127.0.0.1", self.process.port))
        self.line.setblocking(False)

    def run(self, rates, channels, dt) -> np.ndarray:
        self.process.run(dt, channels, rates)
        return self.process.motors[IN_OUR_ORDER]

    def hear(self, data: bytes) -> None:
        self.line.sendall(data)

    def say(self) -> bytes:
        try:
            return self.line.recv(4096)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        self.line.close()
        self.process.close()


class FakeController:
    """As much of it as the companion meets: boxes, arming by a switch that was off, override, raw channels."""

    def __init__(self) -> None:
        self.pending, self.answers, self.msp = b"", b"", [1500] * 16
        self.armed = self.was_off = self.engaged = False

    def run(self, rates, channels, dt) -> np.ndarray:
        self.engaged = channels[5] > 1700
        sticks = [*self.msp[:5]] if self.engaged else list(channels[:5])
        self.was_off |= sticks[4] < 1700
        self.armed = sticks[4] > 1700 and self.was_off
        if not self.armed:
            sticks[4] = 1000
        return (np.array(fake_motors(rates, sticks))[IN_OUR_ORDER] - 1000) / 1000

    def hear(self, data: bytes) -> None:
        self.pending += data
        while len(self.pending) >= 6 and len(self.pending) >= self.pending[3] + 6:
            size, code = self.pending[3], self.pending[4]
            payload, self.pending = self.pending[5 : 5 + size], self.pending[6 + size :]
            if code == 200:
                self.msp[: size // 2] = struct.unpack(f"<{size // 2}H", payload)
            flags = struct.pack("<HHHI", 0, 0, 0, self.armed | self.engaged << 1)
            body = {101: flags, 119: bytes([0, 50])}.get(code, b"")
            body = bytes([len(body), code]) + body
            self.answers += b"$M>" + body + bytes([checksum(body)])

    def say(self) -> bytes:
        said, self.answers = self.answers, b""
        return said

    def close(self) -> None:
        pass


class Hover:
    """A policy that stays where it is."""

    control_dt, next_gate = 0.02, 0

    def act(self, state):
        return np.zeros(4, np.float32), Setpoint(RACER.gravity, (0.0, 0.0, 0.0))


class Aboard:
    """Everything, in simulated time `t`."""

    def __init__(self, controller, policy=None, fence=((-5, -5, 0), (5, 5, 10)), start=(0.0, 0.0, 2.0)) -> None:
        self.t, self.controller = 10.0, controller
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.receiver = Receiver(0)
        self.estimator = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.link = MspLink(serial.Serial(os.ttyname(slave), timeout=0), STICKS)
        os.close(slave)
        self.policy = policy or Hover()
        self.companion = Companion(self.policy, self.link, Limits(*fence), lambda: self.t)
        self.commands: list[tuple[float, float]] = []  # when, and when the newest state that had come was measured
        self.measured = -np.inf
        send = self.link.command

        def command(asked, rate, armed):
            self.commands.append((self.t, self.measured))
            send(asked, rate, armed)

        self.link.command = command
        self.human = [1500, 1500, 988, 1500, 1000, 1000]
        self.motors = np.zeros(4)
        self.state = PLANT.init(jnp.array(start), jnp.array(0.0))
        self.distort = lambda told, t: [told]  # what becomes of a datagram
        self.controller_heard = lambda data: data
        self.stopped: float | None = None

    def odometry(self) -> dict:
        body = self.state.body
        names = ("position_w", "velocity_w", "attitude", "angular_velocity_b")
        return {"time": self.t} | {name: np.asarray(getattr(body, name)).astype(float).tolist() for name in names}

    def run(self, seconds: float, moving: bool = True) -> None:
        """So long; a drone that is not `moving` is held where it is."""
        dt = DT if moving else 5 * DT
        for _ in range(round(seconds / dt)):
            if round(self.t / DT) % 20 == 0:
                self._control_step()
            self._bridge()
            rates = np.asarray(self.state.body.angular_velocity_b, float) if moving else np.zeros(3)
            self.motors = np.asarray(self.controller.run(rates, tuple(self.human), dt))
            if moving:
                self.state = STEP(self.state, jnp.asarray(self.motors, jnp.float32))
            if self.stopped is None and self.companion.samples and self.motors.max() <= 0.001:
                self.stopped = self.t
            self.t += dt

    def _control_step(self) -> None:
        for told in self.distort(self.odometry(), self.t):
            data = told if isinstance(told, bytes) else json.dumps(told).encode()
            self.estimator.sendto(data, ("127.0.0.1", self.receiver.port))
        before = self.receiver.newest
        newest = self.receiver.poll(self.t)
        if newest is not before:
            self.measured = newest.time
        self.companion.step(newest)

    def _bridge(self) -> None:
        if self.master is None:
            return
        if select.select([self.master], [], [], 0)[0]:
            self.controller.hear(os.read(self.master, 4096))
        said = self.controller_heard(self.controller.say())
        if said:
            os.write(self.master, said)

    def unplug(self) -> None:
        """The cable comes off."""
        os.close(self.master)
        self.master = None

    def take_off(self) -> None:
        """A person arms, and hands over while the drone is held at its place; then it is let go."""
        self.run(1.5, moving=False)
        self.human[4] = 2000
        self.run(0.3, moving=False)
        self.human[2] = STICKS.hover(RACER.gravity)[2]
        self.run(0.1, moving=False)
        self.human[5] = 2000
        self.run(0.3, moving=False)

    def close(self) -> None:
        self.link.close()
        self.receiver.close()
        self.estimator.close()
        if self.master is not None:
            self.unplug()
        self.controller.close()
