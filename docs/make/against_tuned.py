"""Compare the shipped policy for all scenarios with the best tuned law of each.

    python docs/make/against_tuned.py RESULTS

RESULTS is a folder of `pter benchmark` with fresh episodes of all scenarios. Writes a table into docs/agents.md.
"""

from itertools import product
from pathlib import Path

import tyro
from pages import AGENTS, BELOW, put_block, signed, table

from pter_gym.benchmark.leaderboard import rank
from pter_gym.benchmark.ranking import Standing
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.runs import ScenarioRun
from pter_gym.benchmark.statistics import Interval, difference_interval
from pter_gym.scenarios import PACES, SCENARIOS

POLICY = "residual"
HEADER = ["Scenario", "Pace", "Best tuned law", "Its error", f"`{POLICY}`", "Share", "Difference", "Peak acceleration"]
UNITS = "[mm]", "[mm]", "[%]", "[mm]", "[m/s²]"


def tuned(runs: list[ScenarioRun]) -> list[ScenarioRun]:
    """Those of laws with tuned gains."""
    return [run for run in runs if run.conditions.policy.endswith("-tuned")]


def compare(runs: list[ScenarioRun]) -> tuple[Standing, Standing, Interval]:
    """The policy, the best tuned law, and the policy's path error less the law's [m], on the same episodes."""
    law = rank(tuned(runs)).standings[0]
    found = {run.conditions.policy: run for run in runs}
    mine, theirs = found[POLICY], found[law.policy]
    errors = (run.scores["path_error_m"] for run in (mine, theirs))
    return rank([mine]).standings[0], law, difference_interval(*errors, strata=mine.strata)


def peak(standing: Standing) -> float:
    """Filtered peak acceleration [m/s²]."""
    return standing.scores["peak_acceleration_m_s2"].value


def row(scenario: str, pace: str, mine: Standing, law: Standing, difference: Interval) -> list[str]:
    """A line of the table."""
    mine_error, law_error = (each.scores["path_error_m"].value for each in (mine, law))
    peaks = (f"{peak(each):.1f}" for each in (mine, law))
    value, low, high = (signed(f"{1000 * number:+z.1f}") for number in difference)
    return [
        f"`{scenario}`",
        pace,
        f"`{law.policy}`",
        f"{1000 * law_error:.1f}{'' if law.rank else f' {BELOW}'}",
        f"{1000 * mine_error:.1f}{'' if mine.rank else f' {BELOW}'}",
        f"{100 * mine_error / law_error:.0f}",
        f"{value} ({low} … {high})",
        " for ".join(peaks),
    ]


def exceptions(found: dict[tuple[str, str], tuple[Standing, Standing, Interval]]) -> str:
    """Say where the policy is not better than the law."""
    kinds = {
        "Larger path error": [place for place, (_, _, difference) in found.items() if difference.low > 0.0],
        "An interval that holds 0": [place for place, (*_, (_, low, high)) in found.items() if low <= 0.0 <= high],
        "Higher peak acceleration": [place for place, (mine, law, _) in found.items() if peak(mine) > peak(law)],
    }
    told = [
        f"- {kind}: {', '.join(f'`{s}` {pace}' for s, pace in places)}." for kind, places in kinds.items() if places
    ]
    return "\n".join([f"Where `{POLICY}` is not better:", "", *told, ""]) if told else ""


def main(results: tyro.conf.Positional[Path], write: bool = True) -> None:
    """Write the table and where the policy is not better into the page, or print them."""
    groups: dict[tuple[str, str], list[ScenarioRun]] = {each: [] for each in product(SCENARIOS, PACES)}
    for run in ResultsFolder(results).runs():
        at = run.conditions
        if at.fresh is not None:
            groups[at.scenario, at.pace].append(run)
    found = {place: compare(runs) for place, runs in groups.items()}
    rows = [row(*place, *compared) for place, compared in found.items()]
    header = [*HEADER[:3], *(f"{name} {unit}" for name, unit in zip(HEADER[3:], UNITS, strict=True))]
    put_block(AGENTS, "against tuned", f"{table(header, rows, '---')}\n{exceptions(found)}", write=write)


if __name__ == "__main__":
    tyro.cli(main)
