"""Draw the picture of a real axis and its simulation: ``python docs/make/real_axis.py``."""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pter_gym.tools.figures import CLUTCH_COLOURS, MUTED, REFERENCE, WIDTH, label, png, styled

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from oracle import emps  # noqa: E402


@styled
def picture() -> Figure:
    """Draw position, difference and command with and without dry friction."""
    figure = Figure(figsize=(WIDTH, 5.4))
    way, apart, volts = figure.subplots(3, 1, sharex=True)
    position, command, _ = emps.record("plain")
    times = emps.INTERVAL * np.arange(len(position))
    way.plot(times, 1e3 * position, color=REFERENCE, linestyle="-", label="recorded")
    for name, dry, colour in (
        ("without dry friction", 0.0, MUTED),
        ("simulated", emps.DRY, CLUTCH_COLOURS[0]),
    ):
        followed, given = emps.follow(emps.published(dry), "plain")
        if dry:
            way.plot(times, 1e3 * followed, color=colour, linestyle="--", label=name)
        look = {"color": colour, "linestyle": "-", "linewidth": 0.9, "label": name}
        apart.plot(times, 1e6 * (followed - position), **look)
        volts.plot(times, given, **look)
    volts.plot(times, command, color=REFERENCE, linestyle="--", linewidth=0.9, label="recorded")
    label(way, "", "position [mm]")
    label(apart, "", "difference [µm]")
    label(volts, "time [s]", "command [V]")
    for axes, high in ((way, 300.0), (apart, 45.0), (volts, 9.0)):
        axes.set_ylim(top=high)
        axes.legend(ncols=3, loc="upper center")
    way.set_xlim(0.0, 12.0)
    return figure


if __name__ == "__main__":
    (ROOT / "docs" / "images" / "emps.png").write_bytes(png(picture()))
