"""Put the scripts of agents/stock, and what came of them, into docs/your-algorithm.md.

`python docs/make/stock_pages.py [RESULTS]`: the table is made of the results folder that the scripts have written to,
and stays as it is without one.
"""

import json
import re
from pathlib import Path
from statistics import median
from typing import NamedTuple

import tyro
from pages import ROOT, table, write_block

from pter_gym.benchmark import PACES
from pter_gym.benchmark.metrics import METRICS
from pter_gym.benchmark.ranking import reason_below
from pter_gym.benchmark.statistics import Interval, interquartile_mean, mean

PAGE = ROOT / "docs" / "your-algorithm.md"
SCRIPTS = ROOT / "agents" / "stock"
LONGEST = 40
"""Lines that the page shows of a script at most."""

SEEDED = re.compile(r"(?P<algorithm>.+)-(?P<seed>\d+)")


class Scored(NamedTuple):
    """What a policy has on the episodes of one pace: path error [mm], rank or none, share of arrivals."""

    error: float
    ranked: bool
    arrives: float

    def __str__(self) -> str:
        shown = f"{self.error:.1f}" if self.ranked else f"({self.error:.1f})"
        return shown if self.arrives >= 0.995 else f"{shown} {100 * self.arrives:.0f} %"


def scored(scores: dict[str, list[float]], pace: str) -> Scored:
    """Return what the scores of a run come to."""
    found = {
        name: Interval(*3 * [float((mean if metric.mean else interquartile_mean)(scores[name]))])
        for name, metric in METRICS.items()
    }
    ranked = reason_below(found, PACES[pace]) is None
    return Scored(1000 * found["path_error_m"].value, ranked, found["completed"].value)


def read_scores(results: Path) -> dict[str, dict[int, dict[str, Scored]]]:
    """Return scores by policy, seed and pace; of the opponent by the seed of the episodes."""
    found: dict[str, dict[int, dict[str, Scored]]] = {}
    for path in sorted((results / "runs").glob("*.json")):
        run = json.loads(path.read_text("utf-8"))
        named = SEEDED.fullmatch(run["policy"])
        name, seed = (named["algorithm"], int(named["seed"])) if named else (run["policy"], run["fresh"])
        found.setdefault(name, {}).setdefault(seed, {})[run["pace"]] = scored(run["scores"], run["pace"])
    return found


def results_table(results: Path) -> str:
    """One line for each policy and seed and one for their median, one column for each pace."""
    rows = []
    for name, seeds in sorted(read_scores(results).items()):
        rows += [[f"`{name}`", str(seed), *(str(at[pace]) for pace in PACES)] for seed, at in sorted(seeds.items())]
        middle = [median(at[pace].error for at in seeds.values()) for pace in PACES]
        rows.append([f"`{name}`", "median", *(f"**{error:.1f}**" for error in middle)])
    return table(["Policy", "Seed", *PACES], rows, "---")


def shown(script: Path) -> str:
    """Return what the page shows of a script: all of it, or its last function if it is long."""
    text = script.read_text("utf-8")
    return text if len(text.splitlines()) <= LONGEST else text[text.rindex("\n\n\ndef ") + 3 :]


def main(results: tyro.conf.Positional[Path | None] = None) -> None:
    """Write the scripts, and the table if there are results."""
    for script in sorted(SCRIPTS.glob("*.py")):
        write_block(PAGE, script.stem, f"```python\n{shown(script)}```\n")
    if results is not None:
        write_block(PAGE, "results", results_table(results))


if __name__ == "__main__":
    tyro.cli(main)
