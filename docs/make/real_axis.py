"""Draw the picture of a real axis and its simulation: ``python docs/make/real_axis.py``.

With ``--table`` it prints what ``pter identify`` finds in the records, in some minutes.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pter_gym.tools.figures import CLUTCH_COLOURS, MUTED, REFERENCE, WIDTH, label, png, styled
from pter_gym.tools.identification import identify

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from oracle import emps  # noqa: E402

UNITS = {"inertia_a": emps.LENGTH**2, "dry_a": emps.LENGTH, "viscous_a": emps.LENGTH**2}
"""Numbers of link A over those of the axis."""


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


def rows() -> Iterator[str]:
    """Yield rows of the table: by encoder and by rows per second, then of the other record."""
    logs = [("plain", bits, every) for bits in (None, 14, 12, 10) for every in (1, 2, 4, 10)]
    for name, bits, every in [*logs, ("pulses", None, 1), ("pulses", 12, 1)]:
        log = emps.log_of(name, bits)
        kept = {column: getattr(log, column)[::every] for column in ("volts", "theta", "force")}
        found = identify(replace(log, interval=every * log.interval, **kept), emps.start())
        told = {each.quantity.name: each for each in found.findings}
        numbers = [
            f"{told[number].quantity.value / unit:.4g} ± {told[number].half_width / unit:.2g}"
            for number, unit in UNITS.items()
        ]
        ends = (100.0 * each for each in (found.verdict.rho_low, found.verdict.rho_high))
        rho = f"{100.0 * found.verdict.rho:.2f} % ({' to '.join(f'{each:.1f}' for each in ends)})"
        encoder = f"{bits} bits" if bits else "as recorded"
        where = encoder if name == "plain" else f"{encoder}, with pulses"
        yield f"| {' | '.join([where, str(1000 // every), found.verdict.grade, rho, *numbers])} |"


if __name__ == "__main__":
    if "--table" in sys.argv:
        for row in rows():
            print(row, flush=True)
    (ROOT / "docs" / "images" / "emps.png").write_bytes(png(picture()))
