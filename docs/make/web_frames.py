"""Measure the frames of the page in Chromium while its handle is dragged, and write them to docs/push-it-yourself.md.

PYTHONPATH=tests python docs/make/web_frames.py
"""

import tempfile
from pathlib import Path

from pages import ROOT, write_block

from browser import find_browser, open_browser
from playing import Play, started
from pter_gym.web.site import site_files

WATCH = """(() => {
  const found = (globalThis.found = { frames: [], work: [], late: [] });
  const { frame } = page;
  let waiting = null;
  document.getElementById("stage").addEventListener("pointermove", (event) => (waiting ??= event.timeStamp));
  page.frame = (time) => {
    const begin = performance.now();
    frame.call(page, time);
    found.frames.push(time);
    found.work.push(performance.now() - begin);
    if (waiting !== null) found.late.push(performance.now() - waiting);
    waiting = null;
  };
})()"""

FOUND = """(() => {
  const middle = (values) => values.sort((a, b) => a - b)[Math.floor(values.length / 2)];
  const { frames, work, late } = found;
  const rate = (1000 * (frames.length - 1)) / (frames.at(-1) - frames[0]);
  return [rate, middle(work), middle(late), frames.length];
})()"""


def main() -> None:
    """Measure and write."""
    program = find_browser()
    if program is None:
        raise SystemExit("no Chromium is installed")
    with started() as address, open_browser(program) as tab, tempfile.TemporaryDirectory() as folder:
        play = Play(tab, address, Path(folder)).open("path=circle&control=residual&pace=slow")
        play.run(WATCH)
        play.drag(away=0.06, seconds=10.0)
        rate, work, late, frames = play.run(FOUND)
    own = sum(file.stat().st_size for name, file in site_files().items() if not name.startswith("policies/"))
    write_block(
        ROOT / "docs" / "push-it-yourself.md",
        "frames",
        f"In headless Chromium without a graphics card, while the handle is dragged, the page draws {rate:.0f} "
        f"frames/s ({frames} frames). A frame\ntakes {work:.1f} ms of work, with the steps of 1 ms of the physics in "
        f"it; from a move of the pointer to its picture {late:.0f} ms pass. The\npage has {own / 1000:.0f} kB with "
        "the simulator; weights of a learned policy are loaded when it is chosen.\n",
    )


if __name__ == "__main__":
    main()
