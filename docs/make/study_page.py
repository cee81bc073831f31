"""The page of `study.py`: docs/stock-algorithms.md, its tables and its figure of learning curves."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pages import BELOW, DOCS, IMAGES, table, write_block

from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.envs.scenario import FRAME_SKIP
from pter_gym.scenarios import PACES
from pter_gym.tools.figures import WIDTH, label, legend_of, looks, save, styled

PAGE = DOCS / "stock-algorithms.md"

FOUND = 0.6
"""An error below this share of the one beside the path that a stuck clutch leaves, 25 mm, needs the manoeuvre."""

BESIDE = 0.025
"""That error at the medium pace [m]: docs/agents.md, "What the policy does with the clutches"."""

Row = Mapping[str, Any]
Curves = Mapping[Any, Sequence[Row]]


def ranks(row: Row) -> bool:
    """Tell whether scores keep the leaderboard's limits at each pace."""
    return all(
        each["completed"] >= COMPLETION and max(each["mean_pace_error"], each["segment_pace_error"]) <= PACE_ERROR
        for each in (row[pace] for pace in PACES)
    )


def errors(rows: Sequence[Row]) -> str:
    """Return the median path errors over seeds at each pace [mm]."""
    return ", ".join(f"{median(1000.0 * row[pace]['path_error_m'] for row in rows):.1f}" for pace in PACES)


def by_seed(rows: Iterable[Row]) -> str:
    """Return the path errors at the medium pace [mm], with a mark where a seed keeps no rank at some pace."""
    return ", ".join(f"{1000.0 * row['medium']['path_error_m']:.1f}{'' if ranks(row) else BELOW}" for row in rows)


def grouped(curves: Curves, part: str, key: Callable[[Any], Any]) -> dict[Any, list[Sequence[Row]]]:
    """Return the curves of a part of the study by what ``key`` says of a run, seeds in order."""
    found: dict[Any, list[Sequence[Row]]] = {}
    for run in sorted(run for run in curves if run.part == part):
        found.setdefault(key(run), []).append(curves[run])
    return found


def summary(name: Sequence[str], runs: Sequence[Sequence[Row]]) -> list[str]:
    """Return a line of a table: what was trained, and how its seeds end."""
    ends = [curve[-1] for curve in runs]
    found = sum(end["medium"]["path_error_m"] < FOUND * BESIDE and ranks(end) for end in ends)
    decisions = median(end["decisions"] for end in ends)
    seconds = median(end["seconds"] for end in ends)
    cost = [f"{decisions / 1e6:.1f} M" if decisions > 1e5 else f"{decisions / 1e3:.0f} k", f"{seconds:.0f} s"]
    return [*name, errors(ends), f"{found} of {len(ends)}", by_seed(ends), *cost]


def noise_table(curves: Curves, part: str) -> str:
    """Return the table of periods and explorations."""
    runs = grouped(curves, part, lambda run: (run.noise, run.period))
    rows = [summary([noise, str(period)], each) for (noise, period), each in sorted(runs.items())]
    return table(["Exploration", "Period", *ENDS], rows, "---")


def libraries(curves: Curves, scenario: str) -> dict[str, list[Sequence[Row]]]:
    """Return the curves of each algorithm of a library; PPO on `standard` is that of the study's other parts."""
    runs = grouped(curves, "stock", lambda run: (run.scenario, run.algorithm))
    mine = {name: each for (of, name), each in runs.items() if of == scenario}
    if scenario == "standard":
        mine |= grouped({run: curves[run] for run in curves if run.noise == "white"}, "ends", period_of)
        mine |= grouped(curves, "readme", lambda _: "PPO, λ = 0.98")
    return mine


def period_of(run: Any) -> str:
    """Return the name of a run of Stable-Baselines3's PPO."""
    return "PPO" if run.period == FRAME_SKIP else f"PPO, period {run.period}"


def stock_table(curves: Curves, scenario: str) -> str:
    """Return the table of the libraries' algorithms."""
    mine = libraries(curves, scenario)
    order = sorted(mine, key=lambda name: median(curve[-1]["medium"]["path_error_m"] for curve in mine[name]))
    return table(["Algorithm", *ENDS], [summary([name], mine[name]) for name in order], "---")


def gradients_table(curves: Curves) -> str:
    """Return the table of scripts that were also given longer: one with gradients beside one without."""
    longer = {run.algorithm for run in curves if run.part == "long"}
    mine = {run: curve for run, curve in curves.items() if run.algorithm in longer}
    runs = [pair for part in ("stock", "long") for pair in grouped(mine, part, lambda run: run.algorithm).items()]
    rows = [summary([name], each) for name, each in sorted(runs, key=lambda pair: pair[0])]
    return table(["Script", *ENDS], rows, "---")


ENDS = ("Path error [mm]", "Manoeuvre, ranked", "Medium pace by seed [mm]", "Decisions", "CPU time")


@styled
def learning_curves(curves: Curves, scenario: str) -> Figure:
    """Return path errors at the medium pace over decisions and over seconds: medians and interquartile bands."""
    mine = libraries(curves, scenario)
    figure = Figure(figsize=(WIDTH, 3.4))
    left, right = figure.subplots(1, 2, sharey=True)
    for name, look in looks(mine).items():
        length = min(map(len, mine[name]))
        if length == 1:  # a script that is scored at its end alone
            continue
        error = np.array([[1000.0 * row["medium"]["path_error_m"] for row in curve[:length]] for curve in mine[name]])
        low, middle, high = np.percentile(error, [25.0, 50.0, 75.0], axis=0)
        for axes, quantity in ((left, "decisions"), (right, "seconds")):
            at = np.median([[row[quantity] for row in curve[:length]] for curve in mine[name]], axis=0)
            axes.plot(at, middle, color=look.colour, linestyle=look.dashes, label=name)
            axes.fill_between(at, low, high, color=look.colour, alpha=0.15, linewidth=0.0)
    left.set(xscale="log", yscale="log")
    label(left, "decisions", "path error [mm]")
    label(right, "processor time [s]", "")
    legend_of(figure, left)
    return figure


def make(curves: Curves) -> None:
    """Write the page's tables and its figures, and the table of docs/gradients.md."""
    write_block(DOCS / "gradients.md", "learning", gradients_table(curves))
    for part in ("noise", "sight", "ends", "readme"):
        write_block(PAGE, part, noise_table(curves, part))
    for scenario in ("standard", "everything"):
        if any(run.part == "stock" and run.scenario == scenario for run in curves):
            write_block(PAGE, f"stock: {scenario}", stock_table(curves, scenario))
    save(learning_curves(curves, "standard"), IMAGES / "learning-standard.png")
