"""The page of `arrangements.py`: docs/which-clutches.md, its table and its figure; its text is written by hand."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from pages import BELOW, DOCS, IMAGES, signed, table, write_block
from study_page import ranks

from pter_gym._internal.files import write_text_atomic
from pter_gym.benchmark.statistics import Interval, bootstrap_interval
from pter_gym.params import Connection
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tools.figures import WIDTH, label, legend_of, looks, save, styled

PAGE = DOCS / "which-clutches.md"
WHO = ("best law", "policy")
KINDS = ("Line", "Circle")
"""Paths of the scenario `paths` that have columns of their own."""

TEXT = """# Which clutches a passive arm needs

(The answer in three sentences: is the coupling worth its clutch, does the inverting gear matter, which ratio is best
for a line and for a circle?)

Only the paper's arrangement was built. On each, control laws are tuned with the same number of trials at each pace,
without the gains that are known for PTER, and `pter train ppo` trains policies. *Best law* has the smallest error on
training draws. Path errors in mm are means over fresh episodes at the slow, medium and brisk pace, with 95 % bootstrap
intervals over the episodes of each seed. † misses the limits of a rank at some pace; of policies, the seeds that keep
them are counted. `python docs/make/arrangements.py` makes table and figure.

<!-- arrangements -->
<!-- /arrangements -->

![Path error of each arrangement](images/arrangements.png)
"""

Found = Mapping[str, Any]
Entries = Mapping[tuple[str, str], tuple[Sequence[Found], Sequence[Found]]]
"""By arrangement and scenario: the best law, as a list of at most one, and the policies of all seeds."""


def interval(seeds: Sequence[Found], kind: str | None = None) -> Interval:
    """Return the mean path error [mm] over paces, seeds and episodes, of one kind of path or all."""
    rows = [
        (error, (seed, pace, stratum))
        for seed, found in enumerate(seeds)
        for pace in PACES
        for stratum, errors in found[pace]["errors"].items()
        for error in errors
        if kind in (None, stratum)
    ]
    values, strata = zip(*rows, strict=True)
    return bootstrap_interval(values, strata=strata)


def cell(seeds: Sequence[Found], kind: str | None = None) -> str:
    """Return a path error, with its interval and how many seeds keep the limits of a rank unless it is of a kind."""
    if not seeds:
        return "–"
    value, low, high = interval(seeds, kind)
    if kind:
        return f"{value:.1f}"
    kept = sum(map(ranks, seeds))
    ranked = f", {kept} of {len(seeds)}" if len(seeds) > 1 else "" if kept else BELOW
    return f"{value:.1f} ({low:.1f} … {high:.1f}){ranked}"


@styled
def figure_of(entries: Entries) -> Figure:
    """Return path errors of the best law and the policies on each arrangement, with intervals."""
    names, scenarios = (list(dict.fromkeys(parts)) for parts in zip(*entries, strict=True))
    figure = Figure(figsize=(WIDTH, 0.8 + 0.32 * len(names)))
    panels = figure.subplots(1, len(scenarios), sharey=True, squeeze=False)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        for k, (who, look) in enumerate(looks(WHO).items()):
            there = [y for y, name in enumerate(names) if entries[name, scenario][k]]
            told = np.array([interval(entries[names[y], scenario][k]) for y in there]).reshape(-1, 3)
            spread = [told[:, 0] - told[:, 1], told[:, 2] - told[:, 0]]
            y = np.array(there) + 0.2 * k - 0.1
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


def make(runs: Mapping[Any, Found], clutches: Mapping[str, Sequence[Connection]]) -> None:
    """Write the page's table and its figure; the page too, if there is none."""
    scenarios = sorted({run.scenario for run in runs}, key=list(SCENARIOS).index)
    entries: dict[tuple[str, str], tuple[list[Found], list[Found]]] = {}
    rows: list[list[str]] = []
    for name, declared in clutches.items():
        rows.append([f"`{name}`", signed(", ".join(f"({each.row[0]:g}, {each.row[1]:g})" for each in declared))])
        for scenario in scenarios:
            mine = {run.what: found for run, found in runs.items() if run[:2] == (name, scenario) and found["training"]}
            best = sorted(mine, key=lambda law: sum(mine[law]["training"].values()))[:1]
            policies = [each for run, each in runs.items() if run[:2] == (name, scenario) and not each["training"]]
            both = entries[name, scenario] = [mine[law] for law in best], policies
            rows[-1] += [", ".join([cell(both[0]), *best]), cell(policies)]
            if scenario == "paths":
                rows[-1] += [f"{cell(both[0], kind)} / {cell(both[1], kind)}" for kind in KINDS]
    header = ["Arrangement", "Rows of W"]
    for scenario in scenarios:
        header += [f"`{scenario}`: {who}" for who in WHO]
        header += [f"{kind}: law / policy" for kind in KINDS if scenario == "paths"]
    if not PAGE.exists():
        write_text_atomic(PAGE, TEXT)
    write_block(PAGE, "arrangements", table(header, rows, "---"))
    save(figure_of(entries), IMAGES / "arrangements.png")
