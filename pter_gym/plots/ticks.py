"""Ticks of logarithmic axes: at round numbers, and at each commanded pace."""

from collections.abc import Iterable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullFormatter

APART = 1.25
"""Smallest ratio of two ticks that each have a label."""

NARROW = 1.6
"""Smallest ratio of the ends of an axis."""

_STEPS = ((1.0, 1.5, 2.0, 3.0, 5.0, 7.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))


def plain_ticks(axes: Axes, which: str, most: int = 8) -> None:
    """Label a logarithmic axis at two or more round numbers; an axis whose ends are nearly equal is widened."""
    low, high = _widened(axes, which)
    _set(axes, which, {tick: f"{tick:.10g}" for tick in round_numbers(low, high, most)})


def round_numbers(low: float, high: float, most: int = 8) -> list[float]:
    """Return round numbers within limits above zero: at least two, if the limits have a ratio of 1.6 or more."""
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    found: list[float] = []
    for steps in _STEPS:
        found = [step * 10.0**decade for decade in decades for step in steps if low <= step * 10.0**decade <= high]
        if len(found) <= most:
            break
    if len(found) >= 3:
        return found
    return [
        float(tick) for tick in MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high) if low <= tick <= high
    ]


def pace_ticks(axes: Axes, paces: Mapping[str, float], slowest: float) -> None:
    """Label a logarithmic axis of paces at each commanded one [m/s], by name, and at round numbers between them.

    What is slower than ``slowest`` is drawn there.
    """
    low, high = _widened(axes, "x", paces.values())
    ticks = {pace: f"{pace:g}\n{name}" for name, pace in paces.items()}
    for tick in [slowest, *round_numbers(low, high)]:
        if low <= tick <= high and all(max(tick / at, at / tick) >= APART for at in ticks):
            ticks[tick] = f"≤ {tick:g}" if tick == slowest else f"{tick:g}"
    _set(axes, "x", ticks)


def _widened(axes: Axes, which: str, shown: Iterable[float] = ()) -> tuple[float, float]:
    """Make an axis wide enough for two ticks and for values that it must show; return its ends."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    values = list(shown)
    low, high = min([low, *(value / 1.1 for value in values)]), max([high, *(value * 1.1 for value in values)])
    factor = max(NARROW / (high / low), 1.0) ** 0.5
    low, high = low / factor, high * factor
    axes.set(**{f"{which}lim": (low, high)})
    return low, high


def _set(axes: Axes, which: str, ticks: Mapping[float, str]) -> None:
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_ticks(list(ticks), list(ticks.values()))
    axis.set_ticks([], minor=True)
    axis.set_minor_formatter(NullFormatter())
