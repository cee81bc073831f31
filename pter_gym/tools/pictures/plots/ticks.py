"""Ticks of logarithmic axes: at round numbers, and at each commanded pace."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter


def plain_ticks(axes: Axes, which: str) -> None:
    """Label a logarithmic axis at round numbers, without powers of ten."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    digits = range(1, 10) if high < 4.0 * low else (1, 2, 5) if high < 100.0 * low else (1,)
    axis.set_major_locator(LogLocator(subs=[float(digit) for digit in digits]))
    axis.set_major_formatter(StrMethodFormatter("{x:.10g}"))
    axis.set_minor_locator(NullLocator())


def pace_ticks(axes: Axes, paces: Mapping[str, float], slowest: float) -> None:
    """Label a logarithmic axis at each commanded pace [m/s] by its name, and at the slowest pace drawn."""
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.9 * min(paces.values())), max(high, 1.1 * max(paces.values())))
    labels = {pace: f"{pace:g}\n{name}" for name, pace in paces.items()}
    if low <= slowest:
        labels[slowest] = f"≤ {slowest:g}"
    axes.set_xticks(list(labels), list(labels.values()))
    axes.xaxis.set_minor_locator(NullLocator())
