"""Put the scripts of agents/stock, and what came of them, into docs/your-algorithm.md.

`python docs/make/stock_pages.py [RESULTS]`: what the results folder holds, to which the scripts have written, goes into
the table; rows of other seeds stay as they are.
"""

import re
from pathlib import Path
from statistics import median
from typing import NamedTuple

import tyro
from pages import ROOT, table, write_block

from pter_gym.benchmark import PACES, ResultsFolder
from pter_gym.benchmark.leaderboard import leaderboards

PAGE = ROOT / "docs" / "your-algorithm.md"
SCRIPTS = ROOT / "agents" / "stock"
LONGEST = 40
"""Lines that the page shows of a script at most."""

SHOWN = re.compile(r"\(?(?P<error>[\d.]+)(?P<unranked>\))?(?: (?P<arrives>\d+) %)?")
"""A cell of the table."""

SEEDED = re.compile(r"(?P<algorithm>.+)-(?P<seed>\d+)")


class Scored(NamedTuple):
    """What a policy has on the episodes of one pace: path error [mm], rank or none, share of arrivals."""

    error: float
    ranked: bool
    arrives: float

    def __str__(self) -> str:
        shown = f"{self.error:.1f}" if self.ranked else f"({self.error:.1f})"
        return shown if self.arrives >= 0.995 else f"{shown} {100 * self.arrives:.0f} %"


Table = dict[str, dict[int, dict[str, Scored]]]
"""Scores by policy, seed and pace."""


def read_cell(text: str) -> Scored:
    """Return what a cell of the table says."""
    found = SHOWN.fullmatch(text)
    if found is None:
        raise ValueError(f"{PAGE} must have cells such as 41.2 or (41.2) 98 %, got {text!r}")
    return Scored(float(found["error"]), not found["unranked"], float(found["arrives"] or 100) / 100)


def read_page(text: str) -> Table:
    """Return what the table of a page says, as ``read_scores`` does."""
    found: Table = {}
    block = re.search(r"<!-- results -->\n(.*?)<!-- /results -->", text, re.DOTALL)
    for line in block[1].splitlines()[2:] if block else []:
        name, seed, *cells = (cell.strip(" `") for cell in line.strip("|").split("|"))
        if seed != "median":
            found.setdefault(name, {})[int(seed)] = dict(zip(PACES, map(read_cell, cells), strict=True))
    return found


def read_scores(results: Path) -> Table:
    """Return scores by policy, seed and pace; of the opponent by the seed of the episodes.

    Runs of other code do not count.
    """
    found: Table = {}
    for board in leaderboards(ResultsFolder(results).runs()):
        for standing in board.standings:
            named = SEEDED.fullmatch(standing.policy)
            name, seed = (named["algorithm"], int(named["seed"])) if named else (standing.policy, board.fresh)
            error, arrives = (standing.scores[score].value for score in ("path_error_m", "completed"))
            here = Scored(1000 * error, standing.rank is not None, arrives)
            found.setdefault(name, {}).setdefault(seed, {})[board.pace] = here
    return found


def results_table(scores: Table) -> str:
    """One line for each policy and seed and one for their median, one column for each pace."""
    rows = []
    for name, seeds in sorted(scores.items()):
        rows += [[f"`{name}`", str(seed), *(str(at[pace]) for pace in PACES)] for seed, at in sorted(seeds.items())]
        middle = [median(at[pace].error for at in seeds.values()) for pace in PACES]
        rows.append([f"`{name}`", "median", *(f"**{error:.1f}**" for error in middle)])
    return table(["Policy", "Seed", *PACES], rows, "---")


def shown(script: Path) -> str:
    """Return what the page shows of a script: all of it, or its last function if it is long."""
    text = script.read_text("utf-8")
    return text if len(text.splitlines()) <= LONGEST else text[text.rindex("\n\n\ndef ") + 3 :]


def put_results(page: Path, results: Path) -> None:
    """Bring a page's table up to date with the runs of a results folder."""
    scores = read_page(page.read_text("utf-8"))
    for name, seeds in read_scores(results).items():
        scores.setdefault(name, {}).update(seeds)
    write_block(page, "results", results_table(scores))


def main(results: tyro.conf.Positional[Path | None] = None) -> None:
    """Write the scripts, and the table if there are results."""
    for script in sorted(SCRIPTS.glob("*.py")):
        write_block(PAGE, script.stem, f"```python\n{shown(script)}```\n")
    if results is not None:
        put_results(PAGE, results)


if __name__ == "__main__":
    tyro.cli(main)
