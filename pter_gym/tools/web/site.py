"""The page as a web site: its files by their addresses, and a server for them on this computer."""

import json
from functools import partial
from http import HTTPStatus
from http.client import HTTP_PORT
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import BoundedSemaphore
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pter_gym._internal.files import FilePath, find_path, write_bytes_atomic
from pter_gym.policies import shipped_policies
from pter_gym.policies._files import SHIPPED

if TYPE_CHECKING:
    from pter_gym.params import Machine

STATIC = Path(__file__).parent / "static"

HOST = "127.0.0.1"

NAMES = ("localhost", HOST, "[::1]")
"""Names of this computer; a page of elsewhere that has itself resolved to this computer goes by another one."""

PATIENCE = 10.0
"""Time that a connection may be silent [s]."""

MOST = 32
"""Connections at a time; others are closed."""

TYPES = MappingProxyType(
    {
        ".html": "text/html; charset=utf-8",
        ".css": "text/css; charset=utf-8",
        ".js": "text/javascript; charset=utf-8",
        ".json": "application/json",
        ".svg": "image/svg+xml",
        ".wasm": "application/wasm",
        ".safetensors": "application/octet-stream",
    }
)
"""Kinds of files that a site has, and what a browser is told of them."""


def site_files() -> dict[str, Path]:
    """Return the files of the page, with shipped weights, by their addresses without a leading slash."""
    own = {path.name: path for path in sorted(STATIC.iterdir()) if path.suffix in TYPES and path.name != "package.json"}
    weights = (f"{name}.safetensors" for name in shipped_policies())
    return own | {f"policies/{name}": SHIPPED / name for name in weights}


def write_site(folder: FilePath) -> None:
    """Copy the page into a folder, from where any web server can serve it."""
    target = find_path("folder", folder)
    for address, file in site_files().items():
        place = target / address
        place.parent.mkdir(parents=True, exist_ok=True)
        write_bytes_atomic(place, file.read_bytes())


def make_server(port: int = 0, own: "Machine | None" = None) -> ThreadingHTTPServer:
    """Return a server of the page for this computer only; a taken port raises an OSError.

    Parameters
    ----------
    port
        Its port, or 0 for any.
    own
        A user's own machine, which the page then starts with.

    Raises
    ------
    ParameterError
        If the page cannot have that machine; see ``pter_gym.tools.web.tables.tables``.
    """
    return _Server((HOST, port), partial(_Handler, site_files(), {} if own is None else _tables(own)))


def _tables(own: "Machine") -> dict[str, bytes]:
    """Return the tables of a page with a machine by their address."""
    from pter_gym.tools.web.tables import TABLES, tables

    return {TABLES.name: json.dumps({**json.loads(TABLES.read_bytes()), **tables(own)}).encode()}


class _Server(ThreadingHTTPServer):
    """Has a thread for each of a number of connections, and closes those beyond it."""

    request_queue_size = MOST

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._free = BoundedSemaphore(MOST)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin to answer, if few enough are answered now."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()


class _Handler(BaseHTTPRequestHandler):
    """Answers with one of the given files, or with what is made in the place of one; there is nothing else."""

    timeout = PATIENCE

    def __init__(self, files: dict[str, Path], made: dict[str, bytes], *arguments: object) -> None:
        self._files = files
        self._made = made
        super().__init__(*arguments)  # pyright: ignore[reportArgumentType]

    def do_GET(self) -> None:
        """Send a file."""
        self._answer(with_content=True)

    def do_HEAD(self) -> None:
        """Send the headers of a file."""
        self._answer(with_content=False)

    def _answer(self, *, with_content: bool) -> None:
        port = self.connection.getsockname()[1]
        ends = ("", f":{port}") if port == HTTP_PORT else (f":{port}",)
        if self.headers.get_all("Host") not in [[name + end] for name in NAMES for end in ends]:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
            return
        address = self.path.partition("?")[0].removeprefix("/") or "index.html"
        file = self._files.get(address)
        if file is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        content = self._made.get(address) or file.read_bytes()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", TYPES[file.suffix])
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-cache")
        self.end_headers()
        if with_content:
            self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Log no requests."""
