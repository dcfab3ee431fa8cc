"""Who may come in, what becomes of who does not keep to the rules, and that races go on whatever pages do."""

import asyncio
import http.client
import json
import urllib.parse

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.evaluation.metrics import race_result
from cruise.human import game as games
from cruise.human.laps import Board, laps_of
from cruise.human.server import Server
from cruise.storage.race_log import load_race_log
from tests.human.games import PATIENCE, run, served, small_game, small_match
from tests.human.hostile import HOSTILE, USUAL


@pytest.fixture
def game(tmp_path):
    return small_game(tmp_path)


def line(server, token=None, origin=None, host=None):
    address = urllib.parse.urlsplit(server.address)
    token = server.token if token is None else token
    headers = {} if host is None else {"Host": host}
    return connect(
        f"ws://{address.netloc}/fly?token={token}",
        origin=origin or f"http://{address.netloc}",
        proxy=None,
        additional_headers=headers,
        open_timeout=PATIENCE,
    )


class Player:
    """A page without a screen."""

    def __init__(self, server, name="Ada"):
        self.server, self.name, self.told = server, name, {}

    async def __aenter__(self):
        self.line = await line(self.server).__aenter__()
        await self.until("phase")
        await self.line.send(json.dumps({"settings": USUAL | {"name": self.name}}))
        return self

    async def __aexit__(self, *_):
        await self.line.close()

    async def take(self):
        message = json.loads(await asyncio.wait_for(self.line.recv(), PATIENCE))
        self.told |= message
        return next(iter(message))

    async def until(self, kind):
        while await self.take() != kind:
            pass

    async def phase(self, name):
        while self.told["phase"]["name"] != name:
            await self.take()

    async def ready(self):
        await self.line.send('{"ready":true}')

    async def sticks(self, *values, n=1):
        await self.line.send(json.dumps({"n": n, "sticks": values}))

    async def push(self, *values):
        """Sticks that stay there."""
        n = 0
        while True:
            n += 1
            await self.sticks(*values, n=n)
            await asyncio.sleep(0.02)


def test_a_page_for_who_has_the_token(game):
    with served(game) as server:
        client = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE)

        def get(path, host=f"127.0.0.1:{server.port}"):
            client.request("GET", path, headers={"Host": host})
            answer = client.getresponse()
            content = answer.read()
            client.close()
            return answer.status, content

        status, content = get(f"/?token={server.token}")
        assert status == 200
        assert b'"fly":{"line":"/fly"}' in content
        assert get("/")[0] == get("/?token=guess")[0] == 403
        assert get(f"/?token={server.token}", host="evil.example")[0] == 403
        assert get(f"/?token={server.token}", host=f"192.168.1.5:{server.port}")[0] == 403
        assert get(f"/etc/passwd?token={server.token}")[0] == 404


def test_no_way_in_from_elsewhere_or_without_the_token(game):
    async def refused(server, **told):
        opening = line(server, **told)
        with pytest.raises(InvalidStatus) as error:
            await opening
        return error.value.response.status_code

    with served(game) as server:
        port = server.port
        for told in (
            {"token": ""},
            {"token": server.token[:-1]},
            {"origin": "http://evil.example"},
            {"origin": f"https://127.0.0.1:{port}"},
            {"origin": f"http://localhost:{port}"},
            {"origin": "null"},
        ):
            assert run(refused(server, **told)) == 403


async def answer_to(server, message):
    """The code with which a line is closed on which that is said."""
    async with line(server) as other:
        await other.send(message)
        await asyncio.wait_for(other.wait_closed(), PATIENCE)
        return other.close_code


def test_fifty_hostile_messages_are_refused_while_a_race_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(games, "GIVE_UP", 1e9)

    async def fly(server):
        async with Player(server) as player:
            await player.ready()
            await player.phase("racing")
            push = asyncio.create_task(player.push(0, 0, 0, 0))
            codes = [await answer_to(server, message) for message in HOSTILE]
            assert codes == [1008] * 50
            assert await answer_to(server, "x" * 5000) == 1009
            before = player.told["state"]["t"]
            while player.told["state"]["t"] < before + 0.2:
                await player.until("state")
            push.cancel()
            assert player.told["phase"]["name"] == "racing"

    with served(small_game(tmp_path, seats=2)) as server:
        run(fly(server))


def test_a_race_is_kept_and_so_is_its_best_lap(tmp_path):
    async def fly(server):
        async with Player(server) as player:
            full = await line(server).__aenter__()
            with pytest.raises(ConnectionClosed) as closed:
                await full.recv()
            assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1013, "all seats are taken")
            push = asyncio.create_task(player.push(0, 1, 0, 0))
            await player.sticks(0, 1, 0, 0)
            await player.ready()
            await player.phase("over")
            push.cancel()
            return player.told

    with served(small_game(tmp_path, hurry=True)) as server:
        told = run(fly(server))
    mine = next(row for row in told["results"] if row["drone"] == 0)
    assert (mine["pilot"], mine["fate"]) == ("human Ada", "finished")
    assert mine["time"] < 60  # in assisted mode, by who only pushes forward
    (file,) = tmp_path.glob("*.npz")
    log = load_race_log(file)
    assert log.pilots.tolist() == ["human Ada", "chaser"]
    assert race_result(log).drones[0].finish_time == pytest.approx(mine["time"], abs=1e-3)
    match = small_match()
    board = Board(tmp_path, match.track, match.vehicle.name)
    (best,) = board.here
    assert best.time == pytest.approx(laps_of(log, 0)[0].time, abs=1e-3)
    assert board.ghost()["time"] == pytest.approx(best.time)
    assert told["board"][0]["name"] == "human Ada"


def test_a_page_that_goes_never_stops_the_race(game, monkeypatch):
    monkeypatch.setattr(games, "GIVE_UP", 0.2)

    async def fly(server):
        async with Player(server) as player:
            await player.sticks(0, 1, 0, 0)
            await player.ready()
            await player.phase("racing")
        while not game.lines:
            await asyncio.sleep(0.05)

    with served(game) as server:
        run(asyncio.wait_for(fly(server), PATIENCE))
    log = load_race_log(next(game.board.folder.glob("*.npz")))
    mine, rival = race_result(log).drones
    assert mine.fate == "retired"
    assert rival.fate == "finished"
    still = log.airborne[:, 0].sum()
    assert log.time[still] < 2.0


def test_a_log_that_cannot_be_written_is_said_and_races_go_on(game, monkeypatch):
    def full(*_):
        raise CruiseError("cannot write it: No space left on device")

    monkeypatch.setattr(games.RaceLog, "save", full)
    monkeypatch.setattr(games, "GIVE_UP", 0.1)

    async def fly(server):
        async with Player(server) as player:
            await player.ready()
            await player.until("notice")
            await player.phase("over")
            await player.ready()
            await player.phase("racing")

    with served(game) as server:
        run(asyncio.wait_for(fly(server), PATIENCE))
    assert game.lines[0] == "not kept: cannot write it: No space left on device"


def test_nothing_is_compiled_once_a_game_is_ready(game):
    import jax

    compiled = []

    def note(name, *_, **__):
        compiled.append(name)

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        race = game._prepare()
        for _ in range(3):
            race.step(games.controls_of(game.seats, 0.0))
        race.retire(0)
        race.step(games.controls_of(game.seats, 0.0))
    finally:
        jax.monitoring.unregister_event_duration_listener(note)
    assert [name for name in compiled if "backend_compile" in name] == []


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (["--seats", "0"], "--seats and --rivals together must be from 1 to 8"),
        (["--seats", "5", "--rivals", "4"], "--seats and --rivals together must be from 1 to 8"),
        (["--rival-pace", "1.5"], "--rival-pace must be from 0.2 to 1"),
        (["--ghost", "a.npz", "--time-optimal"], "give one or the other"),
        (["--pilot", "nobody"], "nobody"),
        (["--rival-vehicle", "no-vehicle"], "no-vehicle"),
        (["--rival-vehicle", "paper"], "vehicles 'racer' and 'paper' cannot share a race"),
        (["--rival-vehicle", "racer", "--rival-vehicle", "racer", "--rivals", "1"], "2 vehicles for 1 drones"),
        (["--track", "no-track"], "no-track"),
    ],
)
def test_flags_that_cannot_be(flags, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["fly", *flags]) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_addresses_that_cannot_be(game):
    with pytest.raises(CruiseError, match="--host takes an address of this machine"):
        Server(game, "my.example")
    with pytest.raises(CruiseError, match=r"cannot serve on 127\.0\.0\.1 port 70000"):
        run(Server(game, port=70000).__aenter__())


@pytest.mark.parametrize(("host", "own"), [("0.0.0.0", "127.0.0.1"), ("::", "[::1]")])
def test_on_all_networks_addresses_are_said_that_can_be_opened(game, host, own):
    server = Server(game, host, 4321)
    assert server.address.startswith(f"http://{own}:4321/?token=")
    elsewhere = server.elsewhere  # None: on no network
    assert elsewhere is None or not elsewhere.startswith((f"http://{host}:", f"http://[{host}]", f"http://{own}"))
    assert Server(game, port=4321).elsewhere is None


def test_a_board_that_is_none(tmp_path):
    (tmp_path / "board.json").write_text('{"version": 7}')
    match = small_match()
    with pytest.raises(CruiseError, match=r"board\.json is no board of best laps of version 1: move it away"):
        Board(tmp_path, match.track, match.vehicle.name)
