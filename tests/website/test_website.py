"""The site as a reader sees it: built without a warning, every page opened in a browser.

`PTER_SITE` names the folder that holds it; `nox -s docs` builds it and runs these tests."""

import os
import re
import time
from collections.abc import Iterator
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).parents[2]
SHOWN = ((1280, 900), (390, 844))
FEW = (
    "index",
    "environment",
    "scenarios/everything",
    "model",
    "commands/benchmark",
    "watching",
    "reference/pter_gym.envs",
)
"""Pages that are opened in the gate: one of each kind."""

LOADED = """Promise.all([...document.images].map(
  (i) => { i.loading = 'eager'; return i.decode().catch(() => {}); }
))"""


@pytest.fixture(scope="module")
def site() -> Path:
    """The folder of the built site."""
    if not (built := os.environ.get("PTER_SITE")):
        pytest.skip("PTER_SITE names no built site; `nox -s docs` builds and tests it")
    return Path(built)


@pytest.fixture(scope="module")
def tab() -> Iterator["browser.Tab"]:  # noqa: F821
    """A tab of the installed Chromium."""
    pytest.importorskip("websockets", reason="driving a browser needs websockets")
    import browser

    program = browser.find_browser()
    if program is None:
        pytest.skip("no Chromium is installed")
    with browser.open_browser(program) as opened:
        yield opened


def pages(site: Path) -> list[str]:
    """Names of all pages; of those that show source code, which are alike and long, one.

    `push` needs a server.
    """
    names = sorted(
        path.relative_to(site).with_suffix("").as_posix() for path in site.rglob("*.html")
    )
    return [name for name in names if not name.startswith(("_modules/", "push/"))] + [
        "_modules/pter_gym/errors"
    ]


def faults(tab: "browser.Tab", address: str) -> list[str]:  # noqa: F821
    """What is wrong with a page at any width."""
    tab.show(*SHOWN[0], "light")
    tab.open(address).run(LOADED)
    look = Path(__file__).with_name("look.js").read_text("utf-8")
    found: list[str] = []
    for width, height in SHOWN:
        tab.show(width, height, "light")
        found += [f"{width} px: {each}" for each in tab.run(look)]
    return [*tab.problems, *found]


def check(tab: "browser.Tab", site: Path, names: list[str]) -> None:  # noqa: F821
    """Open pages; all that is wrong with any is told at once."""
    found = {name: faults(tab, (site / f"{name}.html").as_uri()) for name in names}
    assert not {name: each for name, each in found.items() if each}


@pytest.mark.slow
def test_one_page_of_each_kind(tab: "browser.Tab", site: Path) -> None:  # noqa: F821
    check(tab, site, list(FEW))


@pytest.mark.long
def test_every_page(tab: "browser.Tab", site: Path) -> None:  # noqa: F821
    names = pages(site)
    assert len(names) > 50
    check(tab, site, names)


@pytest.mark.slow
def test_the_arm_can_be_pushed_in_the_site(tab: "browser.Tab", site: Path) -> None:  # noqa: F821
    handler = partial(QuietHandler, directory=str(site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        tab.show(*SHOWN[0], "light")
        tab.open(f"{address}push-it-yourself.html")
        ready = (
            "'ready' in document.querySelector('iframe').contentDocument.documentElement.dataset"
        )
        end = time.monotonic() + 20.0
        while not tab.run(ready) and time.monotonic() < end:
            time.sleep(0.05)
        assert tab.run(ready)
        own = (f"asks the network for {address}", "/favicon.ico")
        assert [each for each in tab.problems if not any(right in each for right in own)] == []
        server.shutdown()


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *arguments: object) -> None:
        pass


class Links(HTMLParser):
    """Where a page leads, and the places within it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.anchors.update(filter(None, (given.get("id"), given.get("name"))))
        self.targets.update(filter(None, (given.get("href"), given.get("src"))))


@pytest.mark.slow
def test_links_within_the_site_lead_somewhere(site: Path) -> None:
    read = {path.resolve(): Links(path.read_text("utf-8")) for path in site.rglob("*.html")}
    assert len(read) > 50
    broken: list[str] = []
    for path, page in read.items():
        for target in page.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            place = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = read[place].anchors if place in read else None
            fragment = unquote(parts.fragment)
            if not place.exists() or (fragment and anchors is not None and fragment not in anchors):
                broken.append(f"{path.relative_to(site.resolve())}: {target}")
    assert not broken


def test_every_public_package_is_in_the_reference() -> None:
    listed = re.findall(
        r"^   (pter_gym[\w.]*)$", (ROOT / "docs" / "api.md").read_text("utf-8"), re.MULTILINE
    )
    assert len(listed) == len(set(listed))
    package = ROOT / "pter_gym"
    public = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for path in package.glob("*/**/__init__.py")
        if "__all__ = " in path.read_text("utf-8") and "/_" not in path.parent.as_posix()
    }
    assert public <= set(listed)
