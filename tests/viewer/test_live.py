"""The live view: who reads gets the newest, and nobody who does not can hold up who publishes."""

import http.client
import json
import socket
import threading
import time

import numpy as np
import pytest

from cruise.cli import race as race_command
from cruise.cli.main import main
from cruise.cli.watch import Watch
from cruise.errors import CruiseError
from cruise.presets import TRACKS, VEHICLES
from cruise.viewer import live_server, training_races
from cruise.viewer.broadcast import BACKLOG, Broadcast
from cruise.viewer.live_server import MOST_CONNECTIONS, LiveServer
from cruise.viewer.packing import pack_race
from cruise.viewer.training_races import TrainingRaces
from tests.training.runs import TINY, bits, tiny_trainer, whole_run
from tests.viewer.races import circle_race

PATIENCE = 120.0  # for a machine that is busy with other things [s]
LARGE = "x" * 300_000  # more than a socket takes from who does not read


@pytest.fixture
def server():
    with LiveServer("test") as running:
        yield running


def port_of(server):
    return int(server.address.rsplit(":", 1)[1].strip("/"))


def connect(server, path="/events", host="127.0.0.1"):
    """A socket that has asked for a path and read nothing yet."""
    connection = socket.create_connection(("127.0.0.1", port_of(server)), timeout=PATIENCE)
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    return connection


def events(connection):
    """Kind and content of what a stream says, from its first event on."""
    kind = None
    with connection.makefile("r", encoding="utf-8") as lines:
        for line in lines:
            if line.startswith("event: "):
                kind = line.removeprefix("event: ").strip()
            elif line.startswith("data: "):
                yield kind, json.loads(line.removeprefix("data: "))


def until(condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_page_and_what_is_said_after_it(server):
    client = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=PATIENCE)
    client.request("GET", "/")
    answer = client.getresponse()
    assert (answer.status, answer.getheader("Content-Type")) == (200, "text/html; charset=utf-8")
    assert b'"live":{"stream":"/events"}' in answer.read()
    server.broadcast.publish("race", {"label": "before"})
    stream = events(connect(server))
    assert next(stream) == ("race", {"label": "before"})
    server.broadcast.publish("race", {"label": "after"})
    assert next(stream) == ("race", {"label": "after"})
    server.close("over")
    assert list(stream) == [("end", {"text": "over"})]


def test_ten_pages_that_do_not_read_hold_up_nobody(server):
    """A hundred times what their sockets take: were anybody waited for, publishing would never end."""
    stuck = [connect(server) for _ in range(10)]
    until(lambda: server.broadcast.listeners == 10)

    def publish():
        for number in range(400):
            server.broadcast.publish("race", {"number": number, "text": LARGE})

    thread = threading.Thread(target=publish, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert max(listener.qsize() for listener in server.broadcast._listeners) <= BACKLOG
    newest = next(content["number"] for _, content in events(connect(server)))
    assert newest == 399
    for connection in stuck:
        connection.close()


def test_a_slow_reader_misses_what_is_old_and_gets_what_is_new(server):
    connection = connect(server)
    until(lambda: server.broadcast.listeners == 1)
    for number in range(200):
        server.broadcast.publish("race", {"number": number, "text": LARGE})
    numbers = []
    for _, content in events(connection):
        numbers.append(content["number"])
        if content["number"] == 199:
            break
    assert numbers == sorted(set(numbers))
    assert len(numbers) < 200


def test_pages_that_are_closed_are_forgotten(server, monkeypatch):
    monkeypatch.setattr(live_server, "HEARTBEAT", 0.02)
    connections = [connect(server) for _ in range(5)]
    until(lambda: server.broadcast.listeners == 5)
    for connection in connections:
        connection.close()
    until(lambda: server.broadcast.listeners == 0)
    server.broadcast.publish("race", {"label": "still served"})
    assert next(events(connect(server))) == ("race", {"label": "still served"})


def test_a_page_that_takes_nothing_is_dropped_in_the_end(monkeypatch):
    monkeypatch.setattr(live_server._Handler, "timeout", 0.1)
    with LiveServer("test") as server:
        connection = connect(server)
        until(lambda: server.broadcast.listeners == 1)
        for _ in range(100):
            server.broadcast.publish("race", {"text": LARGE})
            time.sleep(0.002)
        until(lambda: server.broadcast.listeners == 0)
        connection.close()


def test_more_connections_than_anybody_needs_are_refused(server):
    connections = [connect(server) for _ in range(MOST_CONNECTIONS)]
    until(lambda: server.broadcast.listeners == MOST_CONNECTIONS)
    try:
        with connect(server, "/") as refused:
            assert refused.recv(1) == b""
    except ConnectionError:
        pass
    connections.pop().close()


@pytest.mark.parametrize(("path", "host", "status"), [("/etc/passwd", "127.0.0.1", 404), ("/", "evil.example", 403)])
def test_only_the_page_and_only_for_this_machine(server, path, host, status):
    with connect(server, path, host) as connection:
        assert connection.makefile("rb").readline().split()[1] == str(status).encode()
    assert server._server.server_address[0] == "127.0.0.1"


def test_a_port_that_cannot_be_had(server):
    with pytest.raises(CruiseError, match=r"cannot serve on port \d+: Address already in use; give another --port"):
        LiveServer("second", port_of(server))
    with pytest.raises(CruiseError, match="cannot serve on port 70000: ports go from 0 to 65535"):
        LiveServer("second", 70000)


def test_a_queue_keeps_the_newest():
    broadcast = Broadcast()
    with broadcast.listen() as messages:
        for number in range(10):
            broadcast.publish("race", {"number": number})
        kept = [messages.get_nowait() for _ in range(messages.qsize())]
    assert kept == [b'event: race\ndata: {"number":%d}\n\n' % number for number in range(10 - BACKLOG, 10)]
    assert not broadcast.wait_for_listener(0.0)


def test_training_is_the_same_when_it_is_watched(monkeypatch):
    """With pages that read and pages that do not; the races are those of the policy in training."""
    monkeypatch.setattr(training_races, "PAUSE", 0.0)
    monkeypatch.setattr(training_races, "STATUS_EVERY", 0.0)
    trainer = tiny_trainer()
    with LiveServer("training") as server:
        races = beside(server.broadcast)
        connections = [connect(server) for _ in range(4)]
        seen, told = [], []
        reader = threading.Thread(target=read, args=(connections[0], seen, told), daemon=True)
        reader.start()
        for progress in trainer.run(trainer.initial_state()):
            races.offer(progress)
        while reader.is_alive():
            races.offer(progress)
            reader.join(0.01)
        races.close()
    assert bits(progress.state) == bits(whole_run()[-1].state)
    assert [race["label"] for race in seen][-1] == f"stage 5, {progress.steps / 1e6:.2f} M steps"
    assert told[-1]["text"].startswith("Training: stage 5 Advanced III, 0.0 of 0.0 M steps; last evaluation: success")
    assert all([drone["pilot"] for drone in race["drones"]] == ["policy", "policy"] for race in seen)


def read(connection, races, status):
    """Listen until there were three races, and something was said after the last."""
    for kind, content in events(connection):
        (races if kind == "race" else status).append(content)
        if len(races) >= 3 and kind == "status":
            return


def beside(broadcast):
    """Races beside the tiny training."""
    return TrainingRaces(broadcast, TINY, TRACKS["ring"], VEHICLES["paper"], tiny_trainer().total_steps)


def test_no_race_of_a_training_compiles_anything_but_the_first():
    import jax

    races = beside(Broadcast())
    first, last = whole_run()[0], whole_run()[-1]
    slow = races.fly(jax.tree.map(np.asarray, first.state.model), first.phase.stage.agility, 1)
    compiled = []

    def note(name, *_, **__):
        compiled.append(name)

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        fast = races.fly(jax.tree.map(np.asarray, last.state.model), last.phase.stage.agility, 2)
        during_the_race = [name for name in compiled if "backend_compile" in name]
        jax.jit(lambda x: x * 3 + len(compiled))(1.0)
    finally:
        jax.monitoring.unregister_event_duration_listener(note)
    races.close()
    assert during_the_race == []
    assert [name for name in compiled if "backend_compile" in name] != []  # it would have been noticed
    assert not np.array_equal(slow.position_w[0], fast.position_w[0])


def test_a_view_that_fails_says_so_and_lets_the_training_go_on(monkeypatch):
    broadcast = Broadcast()
    races = beside(broadcast)
    monkeypatch.setattr(races, "fly", lambda *_: 1 / 0)
    with broadcast.listen() as messages:
        until(lambda: races.offer(whole_run()[0]) or not races._thread.is_alive())
        until(lambda: b"The live view has failed: division by zero" in messages.get())
    races.offer(whole_run()[1])
    races.close()


def test_nothing_is_flown_while_nobody_watches():
    races = beside(Broadcast())
    for progress in whole_run():
        races.offer(progress)
    assert races._offers.empty()
    races.close()


def test_watching_a_run_prints_the_address_and_ends_with_it(capsys):
    class Run:
        config, track, trainer = TINY, TRACKS["ring"], tiny_trainer()

    with Watch(watch=True).training(Run()) as offer:
        offer(whole_run()[0])
        line = capsys.readouterr().out
        port = int(line.removeprefix("watch    http://127.0.0.1:").strip().strip("/"))
        socket.create_connection(("127.0.0.1", port)).close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port))
    with Watch().training(Run()) as offer:
        offer(whole_run()[0])
    assert capsys.readouterr().out == ""


def test_race_watch_flies_race_after_race_until_ctrl_c(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    pauses = []

    def pause(seconds):
        pauses.append(seconds)
        if len(pauses) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(race_command.time, "sleep", pause)
    monkeypatch.setattr(Broadcast, "wait_for_listener", lambda self, seconds: True)
    flags = ["--pilot", "chaser", "--pilot", "hover", "--laps", "1", "--seed", "5"]
    assert main(["race", *flags, "--watch"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("watch    http://127.0.0.1:")
    assert lines[2:] == ["seed 5: drone 1 wins", "seed 6: drone 1 wins"]
    assert list(tmp_path.iterdir()) == []
    assert main(["race", *flags, "--watch", "--log", "race.npz"]) == 2
    assert "--watch shows races and writes nothing" in capsys.readouterr().err


def test_the_page_shows_what_arrives(server, open_page):
    page = open_page(server.address, allowed=(server.address,))
    assert "Waiting for the first race" in page.text("#empty")
    server.broadcast.publish("race", pack_race(circle_race(), "one"))
    server.broadcast.publish("status", {"text": "training: stage 1"})
    page.until("replay.races === 1 && replay.state().race === 0 && replay.state().playing")
    page.until("replay.state().time > 0.2")
    assert page.text("#status") == "training: stage 1"
    assert page.text("#badge") == "Live"
    server.broadcast.publish("race", pack_race(circle_race(), "two"))
    page.until("replay.races === 2")
    assert page.state()["race"] == 0  # the one that is seen is seen to its end
    page.run("() => { replay.seek(13.9); replay.play() }")
    page.until("replay.state().race === 1")
    server.close("Training has finished")
    page.until("document.querySelector('#badge').innerText === 'Training has finished'")
    assert page.seek(4.0)["time"] == 4.0


def test_a_race_is_known_before_its_first_picture(server, open_page):
    page = open_page(server.address, allowed=(server.address,))
    page.run("() => { window.requestAnimationFrame = () => 0 }")
    drawn = page.run("replay.frames")
    server.broadcast.publish("race", pack_race(circle_race(), "one"))
    page.until("replay.state().race === 0")
    state = page.state()
    order = [row["drone"] for row in state["standings"]]
    assert sorted(order) == list(range(len(state["drones"])))
    assert state["followed"] == order[0]
    assert page.run("replay.frames") <= drawn + 1  # the one that was already asked for
