"""One port that hands out the page and takes its WebSocket, for whoever has the token."""

import asyncio
import contextlib
import hmac
import http
import ipaddress
import secrets
import socket
import urllib.parse
from typing import Any

from cruise.errors import CruiseError
from cruise.extras import import_extra
from cruise.human.game import Game
from cruise.human.messages import LARGEST, Refused
from cruise.human.seats import Outbox
from cruise.viewer.page import render

LOOPBACK = "127.0.0.1"
LINE = "/fly"
PATIENCE = 5.0  # for a handshake, and for a sign of life [s]
MOST_WAITING = 8  # messages that are taken from one page before it has to wait
REFUSED, FULL = 1008, 1013  # close codes of RFC 6455: policy violation, try again later


class Server:
    """Serves the page of a game and its seats. Use as an asynchronous context manager."""

    def __init__(self, game: Game, host: str = LOOPBACK, port: int = 0) -> None:
        """Nothing is served yet. Raises CruiseError where the library or the address is missing."""
        self.game, self.host, self.port = game, host, port
        self.token = secrets.token_urlsafe(16)
        self.page = render(f"{game.match.track.name}, fly", {"races": [], "fly": {"line": LINE}})
        try:
            self._network = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
        except ValueError:
            raise CruiseError(f"--host takes an address of this machine, as 192.168.1.5, not {host!r}") from None
        self._library = import_extra("websockets.asyncio.server", "fly", "flying needs websockets")
        self._closed = import_extra("websockets.exceptions", "fly", "flying needs websockets").ConnectionClosed
        self._server: Any = None

    @property
    def address(self) -> str:
        """What to open in a browser of this machine; whoever has it may fly."""
        own = "::1" if self._network.version == 6 else LOOPBACK
        return self._address(own if self._network.is_unspecified else str(self._network))

    @property
    def elsewhere(self) -> str | None:
        """What to open on other machines, where all networks are served and this machine is on one."""
        found = reached_at(self._network.version) if self._network.is_unspecified else None
        return found and self._address(found)

    def _address(self, host: str) -> str:
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/?token={self.token}"

    async def __aenter__(self) -> "Server":
        """Begin to serve. Raises CruiseError where the port cannot be had."""
        try:
            self._server = await self._library.serve(
                self._fly,
                str(self._network),
                self.port,
                process_request=self._look_at,
                compression=None,  # a delay for nothing on this machine
                max_size=LARGEST,
                max_queue=MOST_WAITING,
                open_timeout=PATIENCE,
                ping_interval=PATIENCE,
                ping_timeout=PATIENCE,
                close_timeout=1,
                server_header=None,
            )
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "ports go from 0 to 65535"
            raise CruiseError(f"cannot serve on {self.host} port {self.port}: {reason}; give another --port") from None
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()
        await self._server.wait_closed()

    # Who may come in

    def _look_at(self, connection: Any, request: Any) -> Any:
        """The page, a refusal, or None for a WebSocket that may be opened."""
        path, _, query = request.path.partition("?")
        host = request.headers.get_all("Host")
        if len(host) != 1 or not self._knows(host[0]):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "not by this name\n")
        if not hmac.compare_digest(_token(query).encode(), self.token.encode()):
            return connection.respond(http.HTTPStatus.FORBIDDEN, "not without the token\n")
        if path == "/":
            return self._answer(connection)
        if path != LINE:
            return connection.respond(http.HTTPStatus.NOT_FOUND, "nothing here\n")
        if request.headers.get_all("Origin") != [f"http://{host[0]}"]:
            return connection.respond(http.HTTPStatus.FORBIDDEN, "not from another page\n")
        return None

    def _knows(self, host: str) -> bool:
        """Whether a browser got here by an address; a name that leads here from elsewhere is not trusted."""
        name = urllib.parse.urlsplit(f"//{host}").hostname or ""
        if name == "localhost":
            return True
        with contextlib.suppress(ValueError):
            address = ipaddress.ip_address(name)
            return not self._network.is_loopback or address.is_loopback
        return False

    def _answer(self, connection: Any) -> Any:
        response = connection.respond(http.HTTPStatus.OK, "")
        del response.headers["Content-Type"], response.headers["Content-Length"]
        response.headers["Content-Type"] = "text/html; charset=utf-8"
        response.headers["Content-Length"] = str(len(self.page))
        response.headers["Cache-Control"] = "no-store"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.body = self.page
        return response

    # Who sits there

    async def _fly(self, line: Any) -> None:
        """One page, from its coming to its going."""
        seat = self.game.sit()
        if seat is None or seat.outbox is None:
            await line.close(FULL, "all seats are taken")
            return
        sender = asyncio.create_task(self._send(line, seat.outbox))
        try:
            async for message in line:
                seat.hear(message)
        except Refused as reason:
            await line.close(REFUSED, str(reason))
        except self._closed:  # in the middle of something; the race goes on
            pass
        finally:
            seat.leave()
            sender.cancel()

    async def _send(self, line: Any, outbox: Outbox) -> None:
        with contextlib.suppress(self._closed):
            while True:
                await line.send(await outbox.get())


def reached_at(version: int) -> str | None:
    """The address that this machine would send from to the world, and so is reached at; nothing is sent."""
    family, away = (socket.AF_INET6, "2001:db8::1") if version == 6 else (socket.AF_INET, "192.0.2.1")
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as one:
        one.connect((away, 9))  # addresses for documentation: nobody's
        return str(one.getsockname()[0])
    return None


def _token(query: str) -> str:
    return next(iter(urllib.parse.parse_qs(query).get("token", [""])))
