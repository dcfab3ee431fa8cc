"""Messages for whoever listens, without ever waiting for anybody."""

import contextlib
import json
import queue
import threading
from collections.abc import Iterator
from typing import Any

BACKLOG = 4  # messages kept for a listener that does not read; older ones are dropped


class Broadcast:
    """Hands every message to every listener's own short queue. Publishing takes the same time whoever reads or not."""

    def __init__(self) -> None:
        """Nobody listens and nothing has been said."""
        self._lock = threading.Lock()
        self._listeners: set[queue.Queue[bytes]] = set()
        self._newest: dict[str, bytes] = {}  # of every kind, for who comes later
        self._heard = threading.Event()

    def publish(self, kind: str, content: dict[str, Any]) -> None:
        """Say something of a kind ("race", "status", "end") to who listens; its newest is kept for who comes later."""
        message = encode(kind, content)
        with self._lock:
            self._newest[kind] = message
            for listener in self._listeners:
                _put(listener, message)

    @contextlib.contextmanager
    def listen(self) -> Iterator["queue.Queue[bytes]"]:
        """A queue of messages, in it first the newest of every kind."""
        listener: queue.Queue[bytes] = queue.Queue(BACKLOG)
        with self._lock:
            for message in self._newest.values():
                _put(listener, message)
            self._listeners.add(listener)
            self._heard.set()
        try:
            yield listener
        finally:
            with self._lock:
                self._listeners.discard(listener)
                if not self._listeners:
                    self._heard.clear()

    @property
    def listeners(self) -> int:
        """How many listen."""
        with self._lock:
            return len(self._listeners)

    def wait_for_listener(self, seconds: float) -> bool:
        """Whether somebody listens, now or within so many seconds."""
        return self._heard.wait(seconds)


def encode(kind: str, content: dict[str, Any]) -> bytes:
    """A server-sent event."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f"event: {kind}\ndata: {text}\n\n".encode()


def _put(listener: "queue.Queue[bytes]", message: bytes) -> None:
    """Only publishers put, one at a time, so there is room after the oldest has gone."""
    with contextlib.suppress(queue.Empty):
        if listener.full():
            listener.get_nowait()
    listener.put_nowait(message)
