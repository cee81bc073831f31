"""How much better policies do on the stored episodes, which anybody may have tuned to, than on fresh ones."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from pter_gym.benchmark._runs import ScenarioRun, join_seeds
from pter_gym.benchmark.leaderboard import plain_table, seed_text
from pter_gym.benchmark.statistics import Interval, bootstrap_interval, unpaired_interval
from pter_gym.scenarios import PACES

Key = tuple[str, str, str, int]
Fresh = int | str


class Gap(NamedTuple):
    """Path errors [m] of one policy on stored episodes and on fresh ones, and stored less fresh.

    A negative gap means that the stored episodes flatter the policy.
    """

    scenario: str
    pace: str
    policy: str
    fresh: Fresh
    stored_m: Interval
    fresh_m: Interval
    gap_m: Interval

    def as_json(self) -> dict[str, Any]:
        """Return its entry in ``benchmark.json``, in SI."""
        return {name: part._asdict() if isinstance(part, Interval) else part for name, part in self._asdict().items()}


def find_gaps(runs: Sequence[ScenarioRun]) -> tuple[Gap, ...]:
    """Return the gap of each policy and pace with runs on equally many stored and fresh episodes.

    A policy's training seeds count as one; runs belong to the same policy if their identities are known and equal.
    """
    stored: dict[Key, list[ScenarioRun]] = {}
    fresh: dict[tuple[Key, Fresh], list[ScenarioRun]] = {}
    for run in runs:
        at = run.conditions
        key = (at.scenario, at.pace, at.policy, at.episodes)
        if at.fresh is None:
            stored.setdefault(key, []).append(run)
        else:
            fresh.setdefault((key, at.fresh), []).append(run)
    gaps: list[Gap] = []
    for (key, seed), members in fresh.items():
        if key not in stored:
            continue
        before, after = join_seeds(stored[key]), join_seeds(members)
        at = before.conditions
        if at.identity is None or at.identity != after.conditions.identity:
            continue
        old, new = before.scores["path_error_m"], after.scores["path_error_m"]
        stored_m, fresh_m = bootstrap_interval(old, strata=before.strata), bootstrap_interval(new, strata=after.strata)
        gap_m = unpaired_interval(old, new, strata=(before.strata, after.strata))
        gaps.append(Gap(at.scenario, at.pace, at.policy, seed, stored_m, fresh_m, gap_m))
    return tuple(
        sorted(gaps, key=lambda gap: (gap.scenario, str(gap.fresh), PACES[gap.pace], gap.fresh_m.value, gap.policy))
    )


def gap_tables(gaps: Sequence[Gap]) -> list[Table]:
    """Return the gaps in mm for an 80-column terminal: a table for each scenario and seed."""
    tables: list[Table] = []
    for (scenario, seed), members in groupby(gaps, lambda gap: (gap.scenario, gap.fresh)):
        title = f"{scenario}: path error \\[mm], stored less fresh, {seed_text(seed)}"
        tables.append(plain_table(title, ["pace", "policy", "stored", "fresh", "gap"]))
        for gap in members:
            errors = [f"{1000 * value:.1f}" for value in (gap.stored_m.value, gap.fresh_m.value)]
            value, low, high = (1000 * part for part in gap.gap_m)
            tables[-1].add_row(gap.pace, escape(gap.policy), *errors, f"{value:+z.2f} ({low:+z.2f}…{high:+z.2f})")
    return tables
