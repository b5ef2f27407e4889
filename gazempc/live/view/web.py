"""Serves the page: static files, and the state of the run as server-sent events. Needs nothing but Python."""

from __future__ import annotations

import json
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, cast

from gazempc.errors import SettingsError
from gazempc.live.view.orders import LOOPBACK, named
from gazempc.live.view.snapshot import Snapshots
from gazempc.results.moments import Moment
from gazempc.results.run_info import RunInfo

_STATIC = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/charts.js": ("charts.js", "text/javascript; charset=utf-8"),
}
# Nothing from another host, and nobody frames the page. Its icon is empty.
_POLICY = "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'"
# A connection that has heard nothing for so long may be dead; a comment finds out.
_STILL_THERE_S = 5.0


class WebPage:
    """The page and its server, in threads of their own.

    Args:
        run: What the run is.
        host: Address.
        port: Port; 0 for any that is free.

    Attributes:
        url: Where the page is.

    Raises:
        SettingsError: If the address cannot be used.
    """

    def __init__(self, run: RunInfo, host: str, port: int) -> None:
        self._snapshots = Snapshots(run)
        self.news = _News()
        try:
            self._server = _Server((host, port), self)
        except OSError as error:
            why = error.strerror or error
            raise SettingsError(f"--view-at {host}:{port}: {why}; another port: --view-at {host}:PORT") from None
        self.url = f"http://{named(host)}:{self._server.server_address[1]}/"
        threading.Thread(target=self._server.serve_forever, args=(0.1,), name="page", daemon=True).start()

    def take(self, moment: Moment) -> None:
        """Show what happened.

        Args:
            moment: What.
        """
        if self._snapshots.take(moment):
            self.news.tell(json.dumps(self._snapshots.state()))

    def hello(self) -> str:
        """What a page that has just opened needs: what the run is, and its last half minute."""
        return json.dumps({"about": self._snapshots.about, "history": list(self._snapshots.history)})

    @property
    def picture(self) -> bytes:
        """The newest picture of the camera, JPEG; empty without one."""
        return self._snapshots.picture

    def close(self) -> None:
        """Tell pages that the run is over, and stop."""
        self.news.end()
        self._server.shutdown()
        self._server.server_close()


class _News:
    """The newest text. Who is slow misses those between."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._text, self._number, self._over = "", 0, False

    def tell(self, text: str) -> None:
        with self._changed:
            self._text, self._number = text, self._number + 1
            self._changed.notify_all()

    def end(self) -> None:
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def wait(self, after: int) -> tuple[int, str, bool]:
        """Number and text of the newest one after a number (or of the same one, after a while); whether it is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > after or self._over, _STILL_THERE_S)
            return self._number, self._text, self._over


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, address: tuple[str, int], page: WebPage) -> None:
        self.page = page
        super().__init__(address, _Handler)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = 30.0

    def do_GET(self) -> None:
        page, path = cast(_Server, self.server).page, self.path.partition("?")[0]
        if not self._asked_rightly():
            self.send_error(HTTPStatus.FORBIDDEN, "ask by the address that the run prints")
        elif path == "/state":
            self._stream(page)
        elif path == "/picture.jpg" and page.picture:
            self._answer(page.picture, "image/jpeg")
        elif path in _STATIC:
            name, kind = _STATIC[path]
            self._answer(files(__package__).joinpath("page", name).read_bytes(), kind)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _asked_rightly(self) -> bool:
        # A page of somebody else may lead its own name to this computer, and then read what is served here.
        bound = cast(_Server, self.server).server_address[0]
        host = self.headers.get("Host", "").rpartition(":")[0].strip("[]")
        return bound not in LOOPBACK or host in LOOPBACK

    def _answer(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self._headers(kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _stream(self, page: WebPage) -> None:
        self.close_connection = True
        self.send_response(HTTPStatus.OK)
        self._headers("text/event-stream")
        self.send_header("Connection", "close")
        self.end_headers()
        try:
            # After a connection is lost, a page asks again in half a second.
            self._event("hello", page.hello(), "retry: 500\n")
            number, over = 0, False
            while not over:
                newest, text, over = page.news.wait(number)
                if newest > number:
                    self._event("state", text)
                else:
                    self.wfile.write(b": still there\n\n")
                number = newest
            self._event("end", "{}")
        except OSError:
            return  # the page was closed

    def _event(self, name: str, text: str, before: str = "") -> None:
        self.wfile.write(f"{before}event: {name}\ndata: {text}\n\n".encode())
        self.wfile.flush()

    def _headers(self, kind: str) -> None:
        for name, value in (
            ("Content-Type", kind),
            ("Cache-Control", "no-store"),
            ("Content-Security-Policy", _POLICY),
            ("X-Content-Type-Options", "nosniff"),
        ):
            self.send_header(name, value)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are of no interest to who watches the run."""
