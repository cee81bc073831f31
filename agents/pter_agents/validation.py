"""Scores of a policy during training, on drawn episodes that it is not trained on.

Their seed is never used for training episodes; the test episodes stay unseen.
"""

from collections.abc import Sequence

from pter_agents.draws import draws_for
from pter_gym.benchmark import Episodes, evaluate
from pter_gym.controllers import AnyPolicy
from pter_gym.params import BASELINE, Machine, MachineSpread, middle_of

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
        A machine, or machines about one, in place of those that the scenario draws.
    """

    def __init__(
        self,
        scenario: str,
        paces: Sequence[str],
        episodes: int,
        machine: Machine | MachineSpread | None = None,
    ) -> None:
        nominal = BASELINE if machine is None else middle_of(machine)
        self._episodes: dict[str, Episodes] = {}
        for pace in paces:
            pairs = draws_for(scenario, pace, machine).pairs(episodes, SEED)
            machines, tasks = zip(*pairs, strict=True)
            seeds = tuple(range(FIRST_RESET, FIRST_RESET + len(tasks)))
            strata = ("",) * len(tasks)
            self._episodes[pace] = Episodes(scenario, machines, tasks, seeds, strata, nominal)

    def scores(self, policy: AnyPolicy) -> dict[str, dict[str, float]]:
        """Return the mean scores of a policy for each pace."""
        means: dict[str, dict[str, float]] = {}
        for pace, episodes in self._episodes.items():
            scores = evaluate(policy, episodes)
            means[pace] = {name: float(scores[name].mean()) for name in SCORES}
        return means
