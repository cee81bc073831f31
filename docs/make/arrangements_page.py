"""The page of `arrangements.py`: docs/which-clutches.md, its table and its figure; its text is written by hand."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from pages import BELOW, DOCS, IMAGES, signed, table, write_block
from study_page import ranks

from pter_gym.benchmark.statistics import Interval, bootstrap_interval
from pter_gym.params import Connection
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tools.figures import WIDTH, label, legend_of, looks, save, styled

PAGE = DOCS / "which-clutches.md"
WHO = ("best law", "policy")
KINDS = ("Line", "Circle")
"""Paths of the scenario `paths` that have columns of their own."""

Found = Mapping[str, Any]
Entries = Mapping[tuple[str, str], tuple[Found | None, Found | None]]
"""By arrangement and scenario: the best law and the median policy."""


def interval(found: Found, kind: str | None = None) -> Interval:
    """Return the mean path error [mm] over paces and episodes, of one kind of path or all."""
    rows = [
        (error, (pace, stratum))
        for pace in PACES
        for stratum, errors in found[pace]["errors"].items()
        for error in errors
        if kind in (None, stratum)
    ]
    values, strata = zip(*rows, strict=True)
    return bootstrap_interval(values, strata=strata)


def marked(found: Found) -> str:
    """Return a path error, with a mark unless it keeps the limits of a rank."""
    return f"{interval(found).value:.1f}{'' if ranks(found) else BELOW}"


def cell(found: Found | None, *more: str) -> str:
    """Return a path error with its interval and its mark, and what more there is to say."""
    if not found:
        return "–"
    _, low, high = interval(found)
    return f"{marked(found)} ({low:.1f} … {high:.1f}) {' '.join(more)}"


def on(kind: str, *found: Found | None) -> str:
    """Return path errors on one kind of path."""
    return " / ".join(f"{interval(each, kind).value:.1f}" if each else "–" for each in found)


@styled
def figure_of(entries: Entries) -> Figure:
    """Return path errors of the best law and the policies on each arrangement, with intervals."""
    names, scenarios = (list(dict.fromkeys(parts)) for parts in zip(*entries, strict=True))
    figure = Figure(figsize=(WIDTH, 0.8 + 0.32 * len(names)))
    panels = figure.subplots(1, len(scenarios), sharey=True, squeeze=False)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        for k, (who, look) in enumerate(looks(WHO).items()):
            shown = {y: found for y, name in enumerate(names) if (found := entries[name, scenario][k])}
            told = np.array([interval(found) for found in shown.values()]).reshape(-1, 3)
            spread = [told[:, 0] - told[:, 1], told[:, 2] - told[:, 0]]
            y = np.array(list(shown)) + 0.2 * k - 0.1
            axes.errorbar(told[:, 0], y, xerr=spread, fmt=look.marker, color=look.colour, markersize=4.0, label=who)
        axes.set(xscale="log", title=scenario)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        label(axes, "path error [mm]", "")
    panels[0].set_yticks(range(len(names)), names)
    panels[0].invert_yaxis()
    legend_of(figure, panels[0])
    return figure


def make(
    runs: Mapping[Any, Found], laws: Mapping[tuple[str, str], str | None], clutches: Mapping[str, Sequence[Connection]]
) -> None:
    """Write the page's table and its figure.

    Parameters
    ----------
    runs
        What was found.
    laws
        The best law by arrangement and scenario.
    clutches
        The arrangements.
    """
    scenarios = sorted({scenario for _, scenario in laws}, key=list(SCENARIOS).index)
    entries: dict[tuple[str, str], tuple[Found | None, Found | None]] = {}
    rows: list[list[str]] = []
    for name, declared in clutches.items():
        rows.append([f"`{name}`", signed(", ".join(f"({each.row[0]:g}, {each.row[1]:g})" for each in declared))])
        for scenario in scenarios:
            mine = {run: found for run, found in sorted(runs.items()) if run[:2] == (name, scenario)}
            best = next((found for run, found in mine.items() if run.what == laws[name, scenario]), None)
            policies = [found for found in mine.values() if "law" in found]
            ordered = sorted(policies, key=lambda found: interval(found).value)
            middle = ordered[(len(ordered) - 1) // 2] if ordered else None
            both = entries[name, scenario] = best, middle
            seeds = ", ".join(map(marked, policies))
            rows[-1] += [cell(best, laws[name, scenario] or ""), cell(middle, "seeds:", seeds)]
            rows[-1] += [on(kind, *both) for kind in KINDS if scenario == "paths"]
    header = ["Arrangement", "Rows of W"]
    for scenario in scenarios:
        header += [f"`{scenario}`: {who}" for who in WHO]
        header += [f"{kind}: law / policy" for kind in KINDS if scenario == "paths"]
    write_block(PAGE, "arrangements", table(header, rows, "---"))
    save(figure_of(entries), IMAGES / "arrangements.png")
