"""``pter play`` and its page in a browser, as a person uses them."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from browser import Tab

PLAY = "import sys; from pter_gym._commands.main import main; sys.exit(main())"

READY = """(async () => {
  const pause = () => new Promise((done) => setTimeout(done, 20));
  while (!("ready" in document.documentElement.dataset)) await pause();
  globalThis.page = (await import("./page.js")).page;
})()"""

AHEAD = """(() => {
  const [trial] = page.trials;
  const { length } = trial.env.context.task.path;
  const place = (200 * (trial.now.arc_length + AWAY)) / length;
  const [x, y] = trial.line[Math.min(200, Math.round(place))];
  const [end, before] = [trial.line.at(-1), trial.line.at(-2)];
  const beyond = Math.max(0, place - 200);
  const at = { x: x + beyond * (end[0] - before[0]), y: y + beyond * (end[1] - before[1]) };
  return { ...page.scenes[0].screen(at), ended: trial.ended };
})()"""


@contextmanager
def started(*options: str) -> Iterator[str]:
    """Run ``pter play`` and give the address that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-c", PLAY, "play", "--no-open", *options],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait(10)
        process.stdout.close()


class Play:
    """The page in a tab, with what a person does there."""

    def __init__(self, tab: Tab, address: str, downloads: Path) -> None:
        self.tab, self.address, self.downloads = tab, address, downloads

    def open(
        self, width: int = 1280, height: int = 900, scheme: str = "light", **choices: str
    ) -> "Play":
        """Load the page and make choices in its form."""
        self.tab.show(width, height, scheme)
        self.tab.open(self.address)
        self.run(READY)
        for identity, value in choices.items():
            self.choose(identity, value)
        return self

    def run(self, expression: str) -> Any:
        return self.tab.run(expression)

    @property
    def problems(self) -> list[str]:
        """What went wrong; asking its own server is right."""
        own = f"asks the network for {self.address}"
        return [problem for problem in self.tab.problems if own not in problem]

    def text(self, identity: str) -> str:
        return self.run(f"document.getElementById({json.dumps(identity)}).textContent")

    def click(self, identity: str) -> None:
        self.run(f"document.getElementById({json.dumps(identity)}).click()")

    def choose(self, identity: str, value: str) -> None:
        """Choose an option of the form as a person does, and wait until the page has taken it."""
        self.run(
            f"""(async () => {{
              const select = document.getElementById({json.dumps(identity)});
              select.value = {json.dumps(value)};
              if (select.selectedIndex < 0) throw new Error("no such choice");
              select.dispatchEvent(new Event("change", {{ bubbles: true }}));
              const end = performance.now() + 5000;
              const taken = () => page.trials[0].settings[select.id] === select.value;
              const {{ problem }} = globalThis;
              while (!taken() && problem.hidden && performance.now() < end)
                await new Promise((done) => setTimeout(done, 10));
            }})()"""
        )

    def until(self, condition: str, seconds: float = 20.0) -> None:
        end = time.monotonic() + seconds
        while not self.run(condition):
            assert time.monotonic() < end, f"never: {condition}"
            time.sleep(0.03)

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.tab.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1
        )

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        self.tab.call(
            "Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y} for x, y in points]
        )

    def handle(self) -> tuple[float, float]:
        """Where the handle is on the screen [px]."""
        self.run("document.getElementById('stage').scrollIntoView({ block: 'center' })")
        place = self.run("page.scenes[0].screen(page.tip)")
        return place["x"], place["y"]

    def drag(self, *, by_touch: bool = False, away: float = 0.1, seconds: float = 20.0) -> None:
        """Lead the handle along its path until the trial ends."""
        start = self.handle()
        if by_touch:
            self.touch("touchStart", start)
        else:
            self.mouse("mousePressed", *start)
        end = time.monotonic() + seconds
        while (
            not (place := self.run(AHEAD.replace("AWAY", str(away))))["ended"]
            and time.monotonic() < end
        ):
            if by_touch:
                self.touch("touchMove", (place["x"], place["y"]))
            else:
                self.mouse("mouseMoved", place["x"], place["y"])
            time.sleep(0.01)
        if by_touch:
            self.touch("touchEnd")
        else:
            self.mouse("mouseReleased", place["x"], place["y"])

    def key(self, name: str, kind: str) -> None:
        self.tab.call("Input.dispatchKeyEvent", type=kind, key=name, code=name)

    def saved(self, identity: str, name: str) -> Path:
        """Press a button that saves a file, and return the file."""
        file = self.downloads / name
        file.unlink(missing_ok=True)
        # each time, since the browser has one folder for all of its tabs
        self.tab.call(
            "Page.setDownloadBehavior", behavior="allow", downloadPath=str(self.downloads)
        )
        self.click(identity)
        end = time.monotonic() + 60.0
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.03)
        return file.rename(file.with_name(f"{time.monotonic_ns()}-{name}"))


def read_run(file: Path) -> tuple[list[str], list[list[float]]]:
    """Return the names and rows of a run that the page has saved."""
    head, *rows = file.read_text("utf-8").splitlines()
    names = [re.sub(r" \[.*", "", name) for name in head.split(",")]
    return names, [[float(x) for x in row.split(",")] for row in rows]
