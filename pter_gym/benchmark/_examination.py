"""How good a policy is on training draws of a scenario, as one finite number that orders all policies."""

from typing import NamedTuple

import numpy as np

from pter_gym._engine.batch import Batch
from pter_gym.benchmark._find_policy import find_policies
from pter_gym.benchmark._measures import RANKED, Travel
from pter_gym.benchmark.boards import COMPLETION, PACE_ERROR
from pter_gym.benchmark.runs import Policies
from pter_gym.benchmark.simulation import AnyPolicy, run, time_limit
from pter_gym.controllers import bind
from pter_gym.params import Machine
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.tasks.path_following import PathFollowing

RESERVE, MISSING = 0.97, 0.75
"""Parts of the leaderboard's limits on pace errors and on missing completions that the search keeps
to.

Gains that just keep a limit on its draws may miss it on others: the mean pace error over 400 draws
of `everything` has a standard error of 3 % of the limit, and among completions a single draw weighs
much. """

PENALTY = 1.0
"""Path error [m] that counts for each unit over a limit."""

BASELINES = ("free", "locked", "random")
"""Policies that know nothing; any that has learned something is better than each of them."""

UNSEEN = 10_000
"""Seed of draws that no training has by default."""


class Assessment(NamedTuple):
    """Means over draws of the scores that decide ranks."""

    path_error_m: float
    completed: float
    mean_pace_error: float
    segment_pace_error: float

    @property
    def value(self) -> float:
        """The search objective, to be minimised: the path error [m] plus a penalty for each violated limit."""
        over = max(0.0, (1.0 - self.completed) - MISSING * (1.0 - COMPLETION))
        over += max(0.0, self.mean_pace_error - RESERVE * PACE_ERROR)
        over += max(0.0, self.segment_pace_error - RESERVE * PACE_ERROR)
        return self.path_error_m + PENALTY * over

    def __str__(self) -> str:
        """Return the scores as text."""
        arrives, mean, segments = (f"{100 * share:.0f} %" for share in self[1:])
        return f"{1000 * self.path_error_m:.1f} mm, arrives in {arrives}, pace error {mean} (segments {segments})"


class Examination:
    """Training draws of a scenario on which policies are scored; parameters are as in ``examine``."""

    def __init__(
        self,
        scenario: str | Scenario | PathFollowing,
        pace: str,
        episodes: int,
        seed: int,
        machine: Machine | str | None = None,
    ) -> None:
        drawn = find_scenario(scenario, machine)
        pairs = drawn.draws.pairs(episodes, seed, pace)
        pairs.sort(
            key=lambda pair: time_limit(pair[1])
        )  # blocks of worlds then end at about one time
        self.tasks = [task for _, task in pairs]
        self.limits = [time_limit(task) for task in self.tasks]
        self.seeds = [seed * episodes + k for k in range(episodes)]
        self.batch = Batch([machine for machine, _ in pairs], self.tasks)
        self.nominal = drawn.nominal

    def judge(self, policy: AnyPolicy) -> Assessment:
        """Return the means of the scores that decide ranks, as in the benchmark."""
        acting = bind(policy, self.nominal, self.batch.layout)
        telemetry = run(self.batch, acting, self.seeds, self.limits, columns=[*RANKED]).telemetry
        telemetry[np.arange(len(telemetry))[:, None] > np.array(self.limits)] = np.nan
        travel = Travel(telemetry, self.tasks)
        scores = (
            travel.path_error(),
            travel.completed(),
            travel.mean_pace_error(),
            travel.segment_pace_error(),
        )
        return Assessment(*(float(values.mean()) for values in scores))


def examine(
    policies: Policies,
    scenario: str | Scenario | PathFollowing = "standard",
    pace: str = "medium",
    *,
    episodes: int = 64,
    seed: int = UNSEEN,
    machine: Machine | str | None = None,
) -> dict[str, Assessment]:
    """Score policies on training draws, together with ``free``, ``locked`` and ``random``; the best
    comes first.

    Evaluation episodes are not read, so the results may guide further training.

    Parameters
    ----------
    policies
        As in ``run_scenario``; training seeds of one policy are averaged.
    scenario, pace
        As in ``run_scenario``.
    episodes, seed
        Number of draws, and their seed, ≥ 0; training uses ``context_seed``, 0 by default.
    machine
        One machine in place of those that the scenario draws, as in ``find_scenario``; policies
        know about it.
    """
    drawn = find_scenario(scenario, machine)
    examination = Examination(drawn, pace, episodes, seed)
    gains = drawn.whose_gains
    named = find_policies(BASELINES, gains) | (find_policies(policies, gains) if policies else {})
    found = {
        name: Assessment(
            *np.mean([examination.judge(policy) for policy in versions], axis=0).tolist()
        )
        for name, versions in named.items()
    }
    return dict(sorted(found.items(), key=lambda item: item[1].value))
