"""Scores of a policy during training, on drawn episodes that it is not trained on.

Their seed is never used for training draws; the stored evaluation episodes stay unseen.
"""

from collections.abc import Sequence
from typing import Any

from pter_agents.worlds import draws_for
from pter_gym._engine.batch import Batch
from pter_gym.benchmark import score_episodes
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.controllers import Controller
from pter_gym.params import BASELINE, Machine

SEED = 2**31 + 1
"""Seed of the draws, larger than any seed of a run."""

FIRST_RESET = 2**50
"""Seed of the first episode's reset."""

SCORES = (
    "path_error_m",
    "completed",
    "mean_pace_error",
    "segment_pace_error",
    "peak_acceleration_m_s2",
)
"""Those that a rank needs, and the acceleration."""


class Validation:
    """Episodes of a scenario at some paces.

    Parameters
    ----------
    scenario
        Its name.
    paces
        Names of commanded paces.
    episodes
        Number at each pace; with all scenarios, rounded up to equal shares.
    machine
        A machine in place of those that the scenario draws.
    """

    def __init__(
        self,
        scenario: str,
        paces: Sequence[str],
        episodes: int,
        machine: Machine | None = None,
    ) -> None:
        self._tasks: dict[str, Any] = {}
        self._batches: dict[str, Batch] = {}
        for pace in paces:
            pairs = draws_for(scenario, pace, machine).pairs(episodes, SEED)
            machines, tasks = zip(*pairs, strict=True)
            self._tasks[pace] = tasks
            self._batches[pace] = Batch(machines, tasks, sensors="torque")

    def scores(
        self, policy: Controller, nominal: Machine = BASELINE
    ) -> dict[str, dict[str, float]]:
        """Return the mean scores for each pace of a policy that is bound to a nominal machine."""
        found: dict[str, dict[str, float]] = {}
        for pace, batch in self._batches.items():
            tasks = self._tasks[pace]
            seeds = list(range(FIRST_RESET, FIRST_RESET + len(tasks)))
            telemetry = simulate(
                batch, policy.bind(nominal, batch.layout), seeds, max(map(time_limit, tasks))
            )
            values = score_episodes(telemetry, tasks)
            found[pace] = {name: float(values[name].mean()) for name in SCORES}
        return found
