"""`python -m benchmarks.fly`: how well `cruise fly` keeps the clock, and whether its memory stays.

python -m benchmarks.fly latency            # four drones, a page in headless Chromium: step jitter, stick to photon
python -m benchmarks.fly latency chrt -r 5  # the same, `cruise fly` being started by that
python -m benchmarks.fly endurance 3        # three hours of races, as fast as they can be flown: memory
python -m benchmarks.fly endurance 3 paper  # the same in another vehicle
"""

import asyncio
import json
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

SIZE = (640, 360)  # of the page; the processor draws it
MEASURED = 60.0  # [s]
SAY_EVERY = 0.01  # between sticks [s]
READY = 600.0  # for everything to be compiled [s]
PROBE = """() => {
  const buttons = Array.from({ length: 16 }, () => ({ pressed: false, value: 0 }));
  const pad = { index: 0, connected: true, mapping: 'standard', axes: [0, 0, 0, -0.5], buttons };
  navigator.getGamepads = () => [pad];
  const parts = ['to be seen by the page', 'race', 'next picture', 'drawing'];
  window.samples = Object.fromEntries(['stick to picture', ...parts, 'between pictures'].map((name) => [name, []]));
  const note = (name, from, to) => samples[name].push(to - from);
  let moved = null;
  const { line, scene } = fly;
  const send = line.send.bind(line);
  line.send = (message) => {
    if (moved && moved.n === null && message.sticks?.[0] === moved.roll) {
      moved.n = message.n;
      moved.sent = performance.now();
    }
    send(message);
  };
  const take = line.handlers.state;
  line.handlers.state = (state) => {
    take(state);
    if (moved && !moved.back && moved.n !== null && fly.heard >= moved.n) moved.back = performance.now();
  };
  const gl = scene.stage.renderer.getContext();
  const at = scene.clock.at.bind(scene.clock);
  let began = 0;
  scene.clock.at = (now) => {
    began = performance.now();
    return at(now);
  };
  let last = performance.now();
  fly.drawn = () => {
    gl.finish();
    const now = performance.now();
    note('between pictures', last, now);
    last = now;
    if (!moved?.back) return;
    note('stick to picture', moved.at, now);
    note('to be seen by the page', moved.at, moved.sent);
    note('race', moved.sent, moved.back);
    note('next picture', moved.back, began);
    note('drawing', began, now);
    moved = null;
  };
  fly.settings.change({ deadband: 0 });
  let side = 1;
  const move = () => {
    if (moved === null) {
      side = -side;
      pad.axes[2] = 0.2 * side;
      moved = { at: performance.now(), roll: pad.axes[2], n: null };
    }
    setTimeout(move, 90 + 80 * Math.random());
  };
  fly.ready();
  setTimeout(move, 4000);
  setInterval(() => { if (fly.phase.name === 'over') fly.ready(); }, 500);
}"""


def latency(*started_by: str) -> None:
    """Print percentiles of the latency of a page, part by part, and what the command says of its steps."""
    from tests.viewer.browser import Page, chromium  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        command = [*started_by, sys.executable, "-m", "cruise", "fly", "--no-open", "--folder", folder, "--laps", "20"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            address = _address(server)
            with chromium() as browser:
                place = address.split("?")[0]
                page = Page(browser, address, size=SIZE, allowed=(place, place.replace("http", "ws")))
                page.until("fly.own === 0 && fly.frames > 3")
                page.run(PROBE)
                time.sleep(MEASURED)
                samples = page.run("samples")
                page.close()
            server.send_signal(signal.SIGINT)
            print(server.communicate(timeout=60)[0].strip().splitlines()[-1])
        finally:
            server.kill()
    for name, milliseconds in samples.items():
        print(f"{name:22} {len(milliseconds):5}: {_told(milliseconds)}")


def _address(server: subprocess.Popen) -> str:
    end = time.monotonic() + READY
    while time.monotonic() < end:
        line = server.stdout.readline() if server.stdout else ""
        found = re.search(r"http://\S+", line)
        if found:
            return found.group()
        if not line:
            break
    raise SystemExit("cruise fly did not start")


def _told(milliseconds: list[float]) -> str:
    if not milliseconds:
        return "none"
    p50, p95, p99 = np.percentile(milliseconds, [50, 95, 99])
    return f"median {p50:.1f} ms, 95 % {p95:.1f} ms, 99 % {p99:.1f} ms"


def endurance(hours: float, vehicle: str) -> None:
    """Fly race after race against three champions, with a page that reads now and then, and print the memory."""
    from cruise.cli.fly import Fly, timing  # noqa: PLC0415
    from cruise.human.game import Game, Rules  # noqa: PLC0415
    from cruise.human.laps import Board  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        match = Fly(vehicle=vehicle)._match()
        board = Board(Path(folder), match.track, match.vehicle.name)
        game = Game(match, board, Rules(hurry=True), {"best": None, "limit": None}, lambda line: None)
        asyncio.run(_endure(game, 3600 * hours))
        print(timing(game))


async def _endure(game: object, seconds: float) -> None:
    races = asyncio.create_task(game.run())
    seat = game.sit()
    flown, before, told = 0.0, 0.0, -1.0
    number, said, began = 0, -1.0, time.monotonic()
    while flown + before < seconds:
        if time.monotonic() - said > SAY_EVERY:
            number, said = number + 1, time.monotonic()
            seat.hear(json.dumps({"n": number, "sticks": [0.0, 1.0, 0.0, 0.0]}))
        if game.phase["name"] in ("grid", "over"):
            seat.ready = True
        now = game.race.time
        if now < flown:
            before += flown
        flown = now
        for _ in range(3):
            if seat.outbox._waiting:
                await seat.outbox.get()
        if (flown + before) // 600 > told:
            told = (flown + before) // 600
            wall = time.monotonic() - began
            print(
                f"{(flown + before) / 60:6.0f} min flown, {game.flown} races, {_resident():.0f} MB, {wall:.0f} s",
                flush=True,
            )
        await asyncio.sleep(0)
        if races.done():
            races.result()
    races.cancel()


def _resident() -> float:
    """Memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


if __name__ == "__main__":
    what = sys.argv[1] if len(sys.argv) > 1 else ""
    if what == "latency":
        latency(*sys.argv[2:])
    elif what == "endurance":
        endurance(float(sys.argv[2]) if len(sys.argv) > 2 else 3.0, sys.argv[3] if len(sys.argv) > 3 else "racer")
    else:
        raise SystemExit(__doc__)
