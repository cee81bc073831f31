"""Write the table of scores in docs/scoring.md, after one was added or changed: `python docs/make/score_table.py`."""

import tyro
from pages import ROOT, table, write_block

from pter_gym.benchmark.metrics import METRICS

PAGE = ROOT / "docs" / "scoring.md"
NAME = "scores of an episode"


def score_table() -> str:
    """Every score with its unit and meaning, and what counts of many episodes."""
    rows = [
        [f"`{name}`", metric.unit, metric.meaning.replace("|", r"\|"), "mean" if metric.mean else "interquartile mean"]
        for name, metric in METRICS.items()
    ]
    return table(["Score", "Unit", "Meaning", "Of many episodes"], rows, "---")


def main() -> None:
    """Write the table of scores."""
    write_block(PAGE, NAME, score_table())


if __name__ == "__main__":
    tyro.cli(main)
