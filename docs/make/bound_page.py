"""The page of `bound.py`: docs/bound.md, its tables and its figure."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pages import BELOW, DOCS, IMAGES, table, write_block

from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.benchmark.statistics import Interval, bootstrap_interval
from pter_gym.benchmark.tuned import TUNED
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tools.figures import WIDTH, label, legend_of, looks, save, styled

PAGE = DOCS / "bound.md"

Array = NDArray[np.float64]
Blocks = Mapping[Any, Mapping[str, Any]]

TOGETHER = 1e-9
"""Difference of angles [rad] or angular velocities [rad/s] that counts as rounding."""

QUARTILES = (0.25, 0.5, 0.75)

BOUND, TRAINED, LAW = "bound", "best trained policy", "best tuned law"


class Ridden(NamedTuple):
    """Scores on all episodes of a scenario at a pace: arrays by name."""

    name: str
    scores: Mapping[str, Array]

    @property
    def error(self) -> Array:
        """Path errors [mm]."""
        return 1000.0 * self.scores["path_error_m"]

    @property
    def ranks(self) -> bool:
        """Whether the limits of a rank are kept."""
        paces = (self.scores[name].mean() for name in ("mean_pace_error", "segment_pace_error"))
        return self.scores["completed"].mean() >= COMPLETION and max(paces) <= PACE_ERROR


def lines(blocks: Blocks) -> dict[tuple[str, str], dict[str, Ridden]]:
    """Return the bound, the best trained policy and the best tuned law by scenario and pace."""
    found: dict[tuple[str, str], dict[str, Ridden]] = {}
    for scenario in SCENARIOS:
        for pace in PACES:
            runs = [blocks[run] for run in sorted(blocks) if (run.scenario, run.pace) == (scenario, pace)]
            if not runs:
                continue

            def joined(name: str, runs: Any = runs) -> Ridden:
                return Ridden(name, {key: np.concatenate([run[name][key] for run in runs]) for key in runs[0][BOUND]})

            def best(names: Iterable[str], joined: Callable[[str], Ridden] = joined) -> Ridden:
                return min(map(joined, names), key=lambda each: (not each.ranks, each.error.mean()))

            found[scenario, pace] = {BOUND: joined(BOUND), TRAINED: best(shipped_policies()), LAW: best(TUNED)}
    return found


def of_both(line: Mapping[str, Ridden]) -> Ridden:
    """Return the better of the best trained policy and the best tuned law."""
    return min(line[TRAINED], line[LAW], key=lambda each: (not each.ranks, each.error.mean()))


def ratio(line: Mapping[str, Ridden]) -> float:
    """Return the best error over the bound."""
    return float(of_both(line).error.mean() / line[BOUND].error.mean())


def with_interval(found: Interval) -> str:
    """Return a mean with its interval."""
    return f"{found.value:.2f} ({found.low:.2f} … {found.high:.2f})"


def scored(ridden: Ridden) -> str:
    """Return the name, the path error [mm], and a mark if not ranked."""
    return f"`{ridden.name}` {ridden.error.mean():.2f}{'' if ridden.ranks else ' ' + BELOW}"


def bounds_table(blocks: Blocks) -> str:
    """Return the table of all scenarios and paces."""
    rows: list[list[str]] = []
    for (scenario, pace), line in lines(blocks).items():
        bound = line[BOUND]
        paces = (f"±{100.0 * bound.scores[f'{kind}_pace_error'].mean():.0f} %" for kind in ("mean", "segment"))
        mark = "" if bound.ranks else f" {BELOW}"
        rows.append(
            [
                f"{scenario}, {pace}",
                f"{len(bound.error)}",
                with_interval(bootstrap_interval(bound.error)) + mark,
                ", ".join(paces),
                scored(line[TRAINED]),
                scored(line[LAW]),
                f"{ratio(line):.1f}",
            ]
        )
    header = ("Scenario, pace", "Episodes", "Bound", "Its pace", "Best trained policy", "Best tuned law", "Ratio")
    return table(header, rows)


def summary(blocks: Blocks) -> str:
    """Return what the rides cost, and how well both simulations agree."""
    seconds = sum(block["seconds"] for block in blocks.values())
    apart = [block["apart"] for block in blocks.values()]
    together = sum(each < TOGETHER for each in apart)
    return (
        f"\nThis took {seconds / 3600.0:.1f} hours of CPU time, for {len(blocks)} runs. At the end of each control "
        f"step, environment and differentiated rollout differ by less than {TOGETHER:.0e} rad or rad/s in {together} "
        f"of them, and by at most {max(apart):.0e} in the others.\n"
    )


@styled
def distances(blocks: Blocks) -> Figure:
    """Return medians and quartiles of finished rides: bound, best trained policy, best tuned law; a panel each pace."""
    found = lines(blocks)
    names = {BOUND: "best rollout found", TRAINED: TRAINED, LAW: LAW}
    figure = Figure(figsize=(WIDTH, 3.2))
    panels = figure.subplots(1, len(PACES), sharey=True, sharex=True)
    for (pace, speed), axes in zip(PACES.items(), panels, strict=True):
        for shift, (who, look) in zip((-0.2, 0.0, 0.2), looks((BOUND, TRAINED, LAW)).items(), strict=True):
            rides = [found[name, pace][who] for name in SCENARIOS]
            quartiles = np.array([np.quantile(each.error[each.scores["completed"] > 0], QUARTILES) for each in rides])
            low, middle, high = quartiles.T
            rows = np.arange(len(SCENARIOS)) + shift
            sides = middle - low, high - middle
            axes.errorbar(middle, rows, xerr=sides, fmt=look.marker, color=look.colour, label=names[who])
        axes.set(xscale="log", title=f"{pace}, {speed:g} m/s")
        axes.set_xticks((0.05, 0.2, 1.0, 5.0, 20.0), ("0.05", "0.2", "1", "5", "20"))
        axes.set_xticks([], minor=True)
        axes.grid(visible=False, axis="y")
        label(axes, "path error [mm]", "")
    panels[0].set_yticks(range(len(SCENARIOS)), [*SCENARIOS])
    panels[0].set_ylim(len(SCENARIOS) - 0.5, -0.5)
    legend_of(figure, panels[0])
    return figure


def make(blocks: Blocks) -> None:
    """Write the page's table and its figure."""
    write_block(PAGE, "bound", bounds_table(blocks) + summary(blocks))
    save(distances(blocks), IMAGES / "bound.png")
