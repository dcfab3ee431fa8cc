"""The live page and its stream of events, served on this machine's loopback interface."""

import queue
import socket
import socketserver
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from cruise.errors import CruiseError
from cruise.viewer.broadcast import Broadcast
from cruise.viewer.page import render

LOOPBACK = "127.0.0.1"
STREAM = "/events"
PATIENCE = 10.0  # a connection that takes or gives nothing for so long is dropped [s]
HEARTBEAT = 5.0  # between signs of life on a silent stream, by which closed pages are noticed [s]
MOST_CONNECTIONS = 64
FAREWELL = 1.0  # time for the last message to reach the pages [s]


class LiveServer:
    """Serves a page that shows what is published. Use as a context manager, or call `close`."""

    def __init__(self, title: str, port: int = 0) -> None:
        """Start to serve.

        Args:
            title: of the page.
            port: 0 for a free one.

        Raises:
            CruiseError: the port cannot be had.
        """
        self.broadcast = Broadcast()
        page = render(title, {"races": [], "live": {"stream": STREAM}})
        try:
            self._server = _Server((LOOPBACK, port), self.broadcast, page)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "ports go from 0 to 65535"
            raise CruiseError(
                f"cannot serve on port {port}: {reason}; give another --port, or 0 for a free one"
            ) from None
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="live view", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{LOOPBACK}:{self._server.server_address[1]}/"

    def close(self, farewell: str = "Finished") -> None:
        """Tell the pages that it is over, and stop."""
        self.broadcast.publish("end", {"text": farewell})
        self._server.finish()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> "LiveServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Server(ThreadingHTTPServer):
    """A thread for each connection, none of which keeps the program alive, and not too many of them."""

    daemon_threads = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, address: tuple[str, int], broadcast: Broadcast, page: bytes) -> None:
        self.broadcast, self.page = broadcast, page
        self.finished = threading.Event()
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._streams = 0
        self._idle = threading.Condition()
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        """As the class above, but without asking the network for a name of this machine, which can take seconds."""
        socketserver.TCPServer.server_bind(self)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Refuse what is too much."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that went away is no error of ours."""

    def begin_stream(self) -> None:
        """Count a stream that is being served."""
        with self._idle:
            self._streams += 1

    def end_stream(self) -> None:
        """Count it no more."""
        with self._idle:
            self._streams -= 1
            self._idle.notify_all()

    def finish(self) -> None:
        """Let streams end with what they have been told, for a moment."""
        self.finished.set()
        with self._idle:
            self._idle.wait_for(lambda: self._streams == 0, FAREWELL)


class _Handler(BaseHTTPRequestHandler):
    """GET / is the page, GET /events the stream."""

    server: _Server
    timeout = PATIENCE

    def do_GET(self) -> None:
        """Answer a browser of this machine; a name that leads here from elsewhere is not trusted."""
        host = self.headers.get("Host", "").rsplit(":", 1)[0]
        if host not in (LOOPBACK, "localhost"):
            self.send_error(403)
        elif self.path == "/":
            self._answer("text/html; charset=utf-8", self.server.page)
        elif self.path == STREAM:
            self._stream()
        else:
            self.send_error(404)

    def _answer(self, kind: str, content: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.server.begin_stream()
        try:
            with self.server.broadcast.listen() as messages:
                self._pass_on(messages)
        finally:
            self.server.end_stream()

    def _pass_on(self, messages: "queue.Queue[bytes]") -> None:
        """Write messages until there is nobody to read them, or nobody to write them."""
        while True:
            try:
                message = messages.get(timeout=0.0 if self.server.finished.is_set() else HEARTBEAT)
            except queue.Empty:
                if self.server.finished.is_set():
                    return
                message = b": still here\n\n"
            self.wfile.write(message)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are nobody's business."""
