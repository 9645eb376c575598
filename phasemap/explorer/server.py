"""The explorer's page and its answers over HTTP, for this machine alone.

Only 127.0.0.1 listens, every address begins with a token that nobody can guess, and a request that names another host
is refused: a page of somebody else's whose name was pointed here (DNS rebinding) gets nothing. (Behind a JupyterHub the
host is the hub's, which is not known here; the token is.) The page may load
nothing from elsewhere (Content-Security-Policy), and neither it nor the server asks anything of another machine.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import secrets
import socket
import socketserver
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any
from urllib.parse import unquote

from phasemap._shared.errors import PhasemapError
from phasemap._shared.interrupts import stoppable
from phasemap._shared.notices import unquestioned
from phasemap.explorer import routes
from phasemap.explorer.limits import LIMITS, MOVING, TooLong, limiter
from phasemap.explorer.offered import Offered, Opened
from phasemap.explorer.setting import Setting

HOST = "127.0.0.1"
LARGEST, LARGEST_FILE = 1 << 16, 1 << 27  # bytes of what a page sends, and of a file that is opened in it
SILENCE = 5.0  # seconds after which a connection is closed that has not asked for anything with the token
PATIENCE = 60.0  # seconds after which one is closed that has
LENIENCE = 1.0  # seconds that a long answer waits for one that a slider wants
PAGE = {
    "": ("index.html", "text/html; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "knobs.json": ("knobs.json", "application/json"),
    **{
        f"{name}.js": (f"{name}.js", "text/javascript; charset=utf-8")
        for name in ("page", "draw", "engine", "asking", "state", "controls")
    },
}
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

log = logging.getLogger(__name__)


class Gone(Exception):
    """Nobody waits for the answer any more: the page asked for another one, or was closed, or the server is."""


class Server(ThreadingHTTPServer):
    """Serves the page, which begins with what is given, by default a sample; port 0 is any that is free."""

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = os.name == "posix"  # elsewhere it would let others listen too

    def __init__(self, given: Opened | None = None, port: int = 0) -> None:
        self.offered = Offered(given)
        self.prefix = os.environ.get("JUPYTERHUB_SERVICE_PREFIX", "")
        self.token = secrets.token_urlsafe(18)
        self.closing = False
        self.busy = Count()
        self.dragged = Count()
        super().__init__((HOST, port), _Handler)

    def server_bind(self) -> None:
        """Bind, without looking up a name for the address as `HTTPServer` does."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, self.server_address[1]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle is not an error."""
        if not isinstance(sys.exception(), ConnectionError):
            log.exception("the explorer lost a connection")

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    @property
    def proxied(self) -> str:
        """Address of the page on a JupyterHub with jupyter-server-proxy; empty elsewhere."""
        return f"{self.prefix}proxy/{self.server_port}/{self.token}/" if self.prefix else ""

    @property
    def hosts(self) -> tuple[str, str]:
        """Values that the header Host may have."""
        return f"{HOST}:{self.server_port}", f"localhost:{self.server_port}"


class Count:
    """Number of answers that are being made; the event `none` is set while there are none."""

    def __init__(self) -> None:
        self._many, self._lock = 0, threading.Lock()
        self.none = threading.Event()
        self.none.set()

    def __enter__(self) -> None:
        self._add(1)

    def __exit__(self, *_: object) -> None:
        self._add(-1)

    def _add(self, more: int) -> None:
        """Count answers up or down, and set the event when none is left."""
        with self._lock:
            self._many += more
            (self.none.clear if self._many else self.none.set)()


class _Handler(BaseHTTPRequestHandler):
    """Handler of one connection."""

    server: Server
    protocol_version = "HTTP/1.1"
    timeout = SILENCE
    disable_nagle_algorithm = True
    wbufsize = -1

    def do_GET(self) -> None:
        """Give a file of the page, or what it begins with."""
        if (name := self._asked()) is None:
            return
        if name == "start":
            self._answer(name, lambda: routes.start(self.server.offered))
        elif name == "alive":
            self._send(200, routes.JSON, b"{}")
        elif name in PAGE:
            file, kind = PAGE[name]
            self._send(200, kind, files("phasemap.explorer").joinpath("page", file).read_bytes())
        else:
            self._refuse(404, "There is nothing at this address.")

    def do_POST(self) -> None:
        """Answer a setting."""
        if (name := self._asked()) is None:
            return
        opens = name.startswith("open/")
        if (content := self._sent(LARGEST_FILE if opens else LARGEST)) is None:
            return
        if opens:
            self._answer("open", lambda: routes.open_file(self.server.offered, unquote(name[5:]), content))
            return
        try:
            message = json.loads(content)
        except (ValueError, RecursionError):
            self._refuse(400, "The message is not JSON.")
            return
        if name == "sample":
            self._answer(name, lambda: routes.sample(self.server.offered, _sample_of(message)))
        elif (make := routes.answers().get(name)) is None:
            self._refuse(404, "There is nothing at this address.")
        else:
            self._answer(name, lambda: self._of_setting(name, make, message))

    def _of_setting(self, name: str, make: Callable[[Setting], routes.Answer], message: object) -> routes.Answer:
        """Answer a setting; answers that a slider waits for go first."""
        setting = Setting.of(self.server.offered[_sample_of(message)], message)
        dragged = self.server.dragged if LIMITS.get(name) is MOVING else contextlib.nullcontext()
        with stoppable(self._stopper(name, setting)), dragged:
            return make(setting)

    def _sent(self, largest: int) -> bytes | None:
        """Message that was sent with a request; None, with a refusal, if it is too long."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > len(str(largest)) or int(length) > largest:
            self._refuse(413, f"A message has a Content-Length of at most {largest} bytes.")
            return None
        return self.rfile.read(int(length))

    def _asked(self) -> str | None:
        """Name that the request asks for; None if the request is refused."""
        token, _, name = self.path.partition("?")[0].removeprefix("/").partition("/")
        if not self.server.prefix and self.headers.get("Host", "") not in self.server.hosts:
            self._refuse(403, "This address is not served under that name.")
        elif not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._refuse(403, "The address lacks its token; take the whole one that phasemap explore printed.")
        else:
            self.connection.settimeout(PATIENCE)
            return name
        return None

    def _answer(self, name: str, make: Callable[[], tuple[str, bytes]]) -> None:
        """Send the answer that a function makes, or the reason why there is none."""
        try:
            with self.server.busy, unquestioned():  # the page shows every number with its unit
                kind, content = make()
        except Gone:
            self.close_connection = True
        except TooLong as error:
            self._refuse(503, str(error))
        except PhasemapError as error:
            self._refuse(422, str(error))
        except Exception as error:
            log.exception("the explorer could not answer %s", name)
            self._refuse(500, f"Something is wrong in phasemap ({type(error).__name__}: {error}). Please report it.")
        else:
            self._send(200, kind, content)

    def _stopper(self, name: str, setting: Setting) -> Callable[[], None]:
        """Function that stops an answer nobody waits for or that takes too long, and holds up one no slider wants."""
        in_time, waits = limiter(name, setting.scope), LIMITS.get(name) is not MOVING

        def check() -> None:
            if self.server.closing or self._left():
                raise Gone
            in_time()
            if waits:
                self.server.dragged.none.wait(LENIENCE)

        return check

    def _left(self) -> bool:
        """True if the page closed the connection: a browser does so where a question is taken back."""
        self.connection.settimeout(0)
        try:
            return not self.connection.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            return True
        finally:
            self.connection.settimeout(PATIENCE)

    def _refuse(self, code: int, sentence: str) -> None:
        """Send the reason for a refusal, and close: what was sent may not have been read."""
        self.close_connection = self.close_connection or code in (403, 413)
        self._send(code, routes.JSON, json.dumps({"error": sentence}).encode())

    def _send(self, code: int, kind: str, content: bytes) -> None:
        """Send an answer; a page that went away does not want it."""
        try:
            self.send_response(code)
            for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(content))}.items():
                self.send_header(name, value)
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(content)
            self.wfile.flush()
        except (ConnectionError, TimeoutError):
            self.close_connection = True

    def version_string(self) -> str:
        """Value of the header Server."""
        return "phasemap"

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing of a request."""


def _sample_of(message: object) -> object:
    """The name of the sample that a message is about; None for the one that the page begins with."""
    return message.get("sample") if isinstance(message, dict) else None
