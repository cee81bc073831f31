"""The installed Chromium, without a window, by its DevTools protocol."""

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
SECONDS = 60
"""After which a browser that does not answer has failed."""


def find_browser() -> str | None:
    """The program of a Chromium, if there is one."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Tab:
    """An open page; what goes wrong in it is in `problems`."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._number = 0
        self._events: list[str] = []
        self.problems: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    _session: str | None = None

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        return self._call(method, **parameters)

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        number = self._number
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = self._receive()
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def _receive(self) -> dict[str, Any]:
        message = json.loads(self._socket.recv(SECONDS))
        if "method" in message:
            self._events.append(message["method"])
            self.problems.extend(problem(message["method"], message["params"]))
        return message

    def open(self, address: str) -> Self:
        """Load a page and wait until it is there."""
        self.problems.clear()
        self._events.clear()
        self.call("Page.navigate", url=address)
        while "Page.loadEventFired" not in self._events:
            self._receive()
        return self

    def show(self, width: int, height: int, scheme: str) -> None:
        """Set the size of the page [px] and the colour scheme that its reader prefers."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )

    def run(self, expression: str) -> Any:
        """Return what JavaScript comes to."""
        result = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in result:
            raise RuntimeError(str(result["exceptionDetails"]))
        return result["result"].get("value")


def problem(event: str, told: dict[str, Any]) -> Iterator[str]:
    """What an event says that went wrong, if anything."""
    if event == "Runtime.exceptionThrown":
        exception = told["exceptionDetails"].get("exception", {})
        yield f"script error: {exception.get('description', told)}"
    elif event == "Log.entryAdded" and told["entry"]["level"] == "error":
        yield f"error: {told['entry']['text']} {told['entry'].get('url', '')}"
    elif event == "Network.requestWillBeSent" and told["request"]["url"].startswith("http"):
        yield f"asks the network for {told['request']['url']}"


@contextmanager
def open_browser(program: str) -> Iterator[Tab]:
    """Start a Chromium, and end it."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        options = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--remote-debugging-port=0",
            "--hide-scrollbars",
        ]
        process = subprocess.Popen(
            [program, *options, f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            with connect(address(Path(folder), process), max_size=None) as socket:
                yield Tab(socket)
        finally:
            process.terminate()
            process.wait(SECONDS)


def address(folder: Path, process: subprocess.Popen[bytes]) -> str:
    """Where a browser that has just been started listens."""
    told = folder / "DevToolsActivePort"
    end = time.monotonic() + SECONDS
    while time.monotonic() < end and process.poll() is None:
        if told.exists() and len(lines := told.read_text("utf-8").splitlines()) == 2:
            return f"ws://127.0.0.1:{lines[0]}{lines[1]}"
        time.sleep(0.05)
    raise RuntimeError("the browser did not start")
