"""Put what `predictive` reaches on fresh episodes into docs/classical-control.md.

    pter benchmark --scenario SCENARIO --policies single-dof-tuned,residual,predictive --fresh derived \\
        --episodes 100 --out RESULTS
    python docs/make/predictive_table.py RESULTS

RESULTS holds that of `standard`, of `everything`, or of both: an hour of a core and more for each.
"""

from pathlib import Path

import tyro
from classical_pages import PAGE
from pages import board_table, put_block, read_boards
from scenario_pages import PRIVILEGED

SHOWN = (PRIVILEGED, "residual", "single-dof-tuned")


def decisions(boards: list[dict]) -> str:
    """How long a decision took on a scenario, in words."""
    taken = [board["policies"][PRIVILEGED]["planning"]["decision_ms"] for board in boards]
    return f"A decision of `{PRIVILEGED}` took {min(taken):.0f} to {max(taken):.0f} ms of one core.\n"


def section(boards: list[dict], scenario: str) -> str:
    """The leaderboards of a scenario."""
    own = [board for board in boards if board["scenario"] == scenario]
    return f"{board_table(own, scenario, SHOWN, details=True)}\n{decisions(own)}"


def main(results: tyro.conf.Positional[Path], write: bool = True) -> None:
    """Write the tables into the page, or print them."""
    boards = read_boards(results)
    scenarios = dict.fromkeys(board["scenario"] for board in boards)
    content = "\n".join(section(boards, scenario) for scenario in scenarios)
    put_block(PAGE, "predictive", content, write=write)


if __name__ == "__main__":
    tyro.cli(main)
