"""How good a policy is on drawn episodes that it was not trained on, by the benchmark's own scores.

They come from a seed that no training draws use; the stored evaluation episodes stay unseen.
"""

import math
import re
from collections.abc import ItemsView, Sequence
from typing import Any, cast

from pter_agents.worlds import training_draws
from pter_gym.benchmark import score_episodes
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.benchmark.statistics import interquartile_mean
from pter_gym.engine.batch import Batch
from pter_gym.policies import Net, NeuralPolicy
from pter_gym.policies.interface import BoundInterface
from pter_gym.scenarios import PACES
from pter_gym.scenarios.own_machine import OwnMachine
from pter_gym.tasks.path_following import Sensors

Scores = dict[str, dict[str, float]]

SEED = 2**31 + 1
"""Seed of the draws, above all that a run may have."""

FIRST_RESET = 2**50
"""Seed of the first episode's reset."""

RANKED = ("path_error_m", "completed", "mean_pace_error", "segment_pace_error")
"""Scores that a rank needs."""

STEPS = re.compile(r"[0-9]{1,18}")
"""Control steps before a validation, as a file has them."""


def read_scores(content: Any) -> dict[str, Scores]:
    """Return scores by the control steps before each validation, from what a file holds, or raise a ValueError."""
    for steps, scores in _items(content, "it"):
        if not STEPS.fullmatch(steps):
            raise ValueError(f"it must hold scores by numbers of control steps, got {steps!r:.60}")
        for pace, row in _items(scores, steps):
            found = dict(_items(row, pace))
            good = pace in PACES and all(name in found for name in RANKED)
            if not good or not all(type(value) in (int, float) and math.isfinite(value) for value in found.values()):
                raise ValueError(f"it must hold {', '.join(RANKED)} as finite numbers for a pace, got {pace!r:.60}")
    return content


def _items(content: Any, what: str) -> ItemsView[str, Any]:
    if not isinstance(content, dict):
        raise ValueError(f"{what:.60} must be an object")
    return cast("dict[str, Any]", content).items()


class Validation:
    """Episodes of a scenario at some paces.

    Parameters
    ----------
    scenario
        Its name.
    paces
        Names of commanded paces.
    episodes
        Their number at each pace; with all scenarios rounded up to whole shares of each.
    sensors
        What the worlds measure.
    machine
        One in place of those that the scenario draws.
    **stated
        Fields of the task that all episodes share.
    """

    def __init__(
        self,
        scenario: str,
        paces: Sequence[str],
        episodes: int,
        sensors: Sensors = "torque",
        machine: OwnMachine | None = None,
        **stated: Any,
    ) -> None:
        self._tasks: dict[str, Any] = {}
        self._batches: dict[str, Batch] = {}
        for pace in paces:
            draws = training_draws(scenario, pace, contexts=episodes, seed=SEED, machine=machine, **stated)
            machines, tasks = zip(*draws.pairs(), strict=True)
            self._tasks[pace] = tasks
            self._batches[pace] = Batch(machines, tasks, sensors=sensors)

    def scores(self, net: Net, interface: BoundInterface) -> Scores:
        """Return scores for each pace: the interquartile path error, the means of what a rank needs, and acceleration.

        Parameters
        ----------
        net
            From inputs to outputs.
        interface
            What it sees and does.
        """
        found: Scores = {}
        for pace, batch in self._batches.items():
            tasks = self._tasks[pace]
            seeds = list(range(FIRST_RESET, FIRST_RESET + len(tasks)))
            telemetry = simulate(batch, NeuralPolicy(interface, net), seeds, max(map(time_limit, tasks)))
            values = score_episodes(telemetry, tasks)
            found[pace] = {
                "path_error_m": float(interquartile_mean(values["path_error_m"])),
                **{name: float(values[name].mean()) for name in (*RANKED[1:], "peak_acceleration_m_s2")},
            }
        return found
