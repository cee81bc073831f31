"""The page as a web site: its files by their addresses, and a server for them on this computer."""

import sys
from collections.abc import Collection
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import urlsplit

from pter_gym._internal.files import FilePath, expand_path, write_bytes_atomic
from pter_gym.policies import shipped_policies
from pter_gym.policies._files import SHIPPED

PAGES = Path(__file__).parent / "static"
MODULE = PAGES / "pter.wasm"
TABLES = PAGES / "pter.json"

HOST = "127.0.0.1"

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
"""Extensions of the page's files and their media types."""


def site_files() -> dict[str, Path]:
    """Return the files of the page, with shipped weights, by addresses without a leading slash."""
    own = {
        path.name: path
        for path in sorted(PAGES.iterdir())
        if path.suffix in TYPES and path.name != "package.json"
    }
    weights = (f"{name}.safetensors" for name in shipped_policies())
    return own | {f"policies/{name}": SHIPPED / name for name in weights}


def write_site(folder: FilePath) -> None:
    """Copy the page into a folder, from where any web server can serve it."""
    target = expand_path("folder", folder)
    for address, file in site_files().items():
        place = target / address
        place.parent.mkdir(parents=True, exist_ok=True)
        write_bytes_atomic(place, file.read_bytes())


def make_server(port: int = 0, allowed_hosts: Collection[str] = ()) -> ThreadingHTTPServer:
    """Return a server of the page for this computer only; a taken port raises an OSError.

    It answers requests to ``localhost``, to IP addresses and to ``allowed_hosts``, at any port,
    since a tunnel may lead here from another one. Any other name may belong to a web page that
    resolves its own name to this computer.

    Parameters
    ----------
    port
        Its port, or 0 for any.
    allowed_hosts
        Names of other hosts under which a browser reaches this server.
    """
    hosts = {"localhost", *map(str.lower, allowed_hosts)}
    return _Server((HOST, port), partial(_Handler, site_files(), hosts))


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print a traceback, unless the browser has closed the connection or stopped reading."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Serves a fixed set of files and nothing else."""

    timeout = 10.0  # seconds for which a connection may be silent

    def __init__(self, files: dict[str, Path], hosts: set[str], *arguments: object) -> None:
        self._files, self._hosts = files, hosts
        super().__init__(*arguments)  # pyright: ignore[reportArgumentType]

    def do_GET(self) -> None:
        """Send a file."""
        self._answer(with_content=True)

    def do_HEAD(self) -> None:
        """Send the headers of a file."""
        self._answer(with_content=False)

    def _answer(self, *, with_content: bool) -> None:
        host = _host_name(self.headers.get_all("Host", []))
        if not (host in self._hosts or _is_ip_address(host)):
            hint = f"To reach this page as {host}, start it with: pter play --allow-host {host}"
            self.send_error(
                HTTPStatus.MISDIRECTED_REQUEST, explain=hint if host else "A Host header is needed."
            )
            return
        address = self.path.partition("?")[0].removeprefix("/") or "index.html"
        file = self._files.get(address)
        if file is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        content = file.read_bytes()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", TYPES[file.suffix])
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-cache")
        self.end_headers()
        if with_content:
            self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Log no requests."""


def _host_name(headers: list[str]) -> str:
    """Return the host of a request's only Host header in lower case without its port, or ""."""
    with suppress(ValueError):  # not an address, as "[::1" is not
        return urlsplit(f"//{headers[0]}").hostname or "" if len(headers) == 1 else ""
    return ""


def _is_ip_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True
