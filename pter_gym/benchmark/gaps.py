"""How much better policies look on the stored episodes, which anybody may have tuned to, than on fresh ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from rich.markup import escape
from rich.table import Table

from pter_gym.benchmark.runs import ScenarioRun, join_seeds
from pter_gym.benchmark.statistics import Interval, bootstrap_interval, unpaired_interval
from pter_gym.scenarios import PACES


@dataclass(frozen=True)
class Gap:
    """Path error of one policy on stored and on fresh episodes, with intervals.

    Attributes
    ----------
    scenario, pace, policy
        Names.
    seed
        Of the fresh episodes.
    stored, fresh
        Path errors [m].
    gap
        Stored less fresh [m]; below zero where the stored ones flatter.
    """

    scenario: str
    pace: str
    policy: str
    seed: int
    stored: Interval
    fresh: Interval
    gap: Interval

    def as_json(self) -> dict[str, Any]:
        """Return what ``benchmark.json`` holds of it, in SI."""
        errors = {"stored_m": self.stored, "fresh_m": self.fresh, "gap_m": self.gap}
        return {
            "scenario": self.scenario,
            "pace": self.pace,
            "policy": self.policy,
            "fresh": self.seed,
            **{name: interval._asdict() for name, interval in errors.items()},
        }


def find_gaps(runs: Sequence[ScenarioRun]) -> tuple[Gap, ...]:
    """Return the gap of each policy and pace that has runs on as many stored episodes as on fresh ones.

    A policy's training seeds count as one; runs are of the same policy if their identities are known and the same.
    """
    groups: dict[tuple[str, str, str, int], dict[int | None, list[ScenarioRun]]] = {}
    for run in runs:
        at = run.conditions
        sets = groups.setdefault((at.scenario, at.pace, at.policy, at.episodes), {})
        sets.setdefault(at.fresh, []).append(run)
    found = [
        _gap(stored, join_seeds(sets[seed]), seed)
        for sets in groups.values()
        if None in sets
        for stored in [join_seeds(sets[None])]
        if stored.conditions.identity is not None
        for seed in sorted(seed for seed in sets if seed is not None)
        if join_seeds(sets[seed]).conditions.identity == stored.conditions.identity
    ]
    return tuple(sorted(found, key=lambda gap: (gap.scenario, gap.seed, PACES[gap.pace], gap.fresh.value, gap.policy)))


def gap_tables(gaps: Sequence[Gap]) -> list[Table]:
    """Return what ``find_gaps`` found for a terminal of 80 columns, in mm: a table for each scenario and seed."""
    return [
        _table(f"{scenario}: path error \\[mm], stored less fresh of seed {seed}", list(members))
        for (scenario, seed), members in groupby(gaps, lambda gap: (gap.scenario, gap.seed))
    ]


def _table(title: str, gaps: Sequence[Gap]) -> Table:
    table = Table(title=title, box=None, padding=(0, 1), collapse_padding=True, pad_edge=False)
    for header in ("pace", "policy"):
        table.add_column(header, no_wrap=True)
    for header in ("stored", "fresh", "gap"):
        table.add_column(header, justify="right", no_wrap=True)
    for gap in gaps:
        errors = [f"{1000 * value:.1f}" for value in (gap.stored.value, gap.fresh.value)]
        value, low, high = (1000 * part for part in gap.gap)
        table.add_row(gap.pace, escape(gap.policy), *errors, f"{value:+z.2f} ({low:+z.2f}…{high:+z.2f})")
    return table


def _gap(stored: ScenarioRun, fresh: ScenarioRun, seed: int) -> Gap:
    at = stored.conditions
    before, after = (run.scores["path_error_m"] for run in (stored, fresh))
    return Gap(
        scenario=at.scenario,
        pace=at.pace,
        policy=at.policy,
        seed=seed,
        stored=bootstrap_interval(before, strata=stored.strata),
        fresh=bootstrap_interval(after, strata=fresh.strata),
        gap=unpaired_interval(before, after, strata=(stored.strata, fresh.strata)),
    )
