"""A small game that the tests of this folder share, and a server of it in a thread."""

import asyncio
import concurrent.futures
import contextlib
import functools
import threading

from cruise.cli.fly import Fly
from cruise.human.game import Game, Rules
from cruise.human.laps import Board
from cruise.human.server import Server

PATIENCE = 120.0  # for a machine that is busy with other things [s]


@functools.cache
def small_match(seats=1):
    """People and one chaser in racers on the ring, one lap."""
    return Fly(seats=seats, pilot=("chaser",), laps=1)._match()


def small_game(folder, seats=1, **rules):
    match = small_match(seats)
    board = Board(folder, match.track, match.vehicle.name)
    lines = []
    game = Game(
        match, board, Rules(**({"countdown": 0.05} | rules)), {"best": board.ghost(), "limit": None}, lines.append
    )
    game.lines = lines
    return game


def run(coroutine):
    """What it gives; in a thread of its own, for a browser that other tests opened keeps a loop in this one."""
    with concurrent.futures.ThreadPoolExecutor(1) as threads:
        return threads.submit(asyncio.run, coroutine).result()


@contextlib.contextmanager
def served(game):
    """A server in a thread of its own."""
    loop, ready, running = asyncio.new_event_loop(), threading.Event(), []

    async def serve():
        async with Server(game) as server:
            running.append(server)
            task = asyncio.current_task()
            running.append(lambda: loop.call_soon_threadsafe(task.cancel))
            ready.set()
            await game.run()

    def work():
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(serve())
        loop.close()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(PATIENCE)
    yield running[0]
    running[1]()
    thread.join(PATIENCE)
    assert not thread.is_alive()
