"""The commanded paces, and the paper's gains at them: all stay but the damper along the path, which sets the pace.

The gains were made for about 0.5 m/s. ``damping_for_pace`` solves the damper for a commanded pace on drawn episodes,
none of which is an evaluation episode; ``.ci/solve_paces.py`` writes the table that the package ships.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType

import numpy as np

from pter_gym.benchmark.metrics import score_episodes
from pter_gym.benchmark.runs import PACKAGE
from pter_gym.benchmark.simulation import AnyPolicy, bind, simulate, time_limit
from pter_gym.benchmark.standard import find_controller
from pter_gym.controllers import CONTROLLERS, Controller
from pter_gym.controllers.impedance import Impedance
from pter_gym.envs.batch import Batch
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.operators import SINES, MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import PathFollowing

TABLE = PACKAGE / "presets" / "paces.toml"

DRAWS = 32
"""Random phase sets of Eq. 5 on which the damper is solved."""

SEED = 5
"""Seed of the draws."""

LOWEST, HIGHEST = 10.0, 3000.0
"""Range of the search [N·s/m]."""


@dataclass(frozen=True)
class PerPace:
    """One policy for each commanded pace, by the pace's name."""

    policies: Mapping[str, Controller | AnyPolicy]

    def at(self, pace: str) -> Controller | AnyPolicy:
        """Return the policy for a pace, or raise a ParameterError with the nearest names."""
        if pace not in self.policies:
            raise unknown_name("paces", pace, self.policies)
        return self.policies[pace]


def find_policy(name: str, seed: int = 0) -> Controller | PerPace:
    """Return a built-in controller by name, with the damper for each pace where the table has one, or a trained policy.

    Raises
    ------
    ParameterError
        If there is neither of that name.
    """
    controller = find_controller(name, seed)
    dampers = damping_table().get(name)
    if dampers is None or not isinstance(controller, Impedance):
        return controller
    return PerPace({pace: replace(controller, damping_tangential=damping) for pace, damping in dampers.items()})


@cache
def damping_table() -> Mapping[str, Mapping[str, float]]:
    """Return the damper along the path [N·s/m] by controller and pace."""
    return MappingProxyType(tomllib.loads(TABLE.read_text(encoding="utf-8")))


def damping_for_pace(controller: Impedance, pace: float, *, draws: int = DRAWS, seed: int = SEED) -> float:
    """Return the damper along the path [N·s/m] with which a controller keeps a mean pace on the default task.

    Parameters
    ----------
    controller
        Its other gains stay.
    pace
        Commanded mean speed along the path [m/s].
    draws, seed
        Number and seed of the random phase sets of Eq. 5 over which the pace is averaged.

    Raises
    ------
    ParameterError
        If no damper from 10 to 3000 N·s/m gives that pace.
    """
    tasks = drawn_tasks(pace, draws, seed)
    low, high = math.log(LOWEST), math.log(HIGHEST)
    slowest, fastest = (_mean_pace(replace(controller, damping_tangential=d), tasks) for d in (HIGHEST, LOWEST))
    if not slowest <= pace <= fastest:
        raise ParameterError(f"pace must be from {slowest:.3g} to {fastest:.3g} m/s for these gains, got {pace!r}")
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        if _mean_pace(replace(controller, damping_tangential=math.exp(middle)), tasks) > pace:
            low = middle
        else:
            high = middle
    return math.exp(0.5 * (low + high))


def drawn_tasks(pace: float, draws: int, seed: int) -> list[PathFollowing]:
    """Return the default task with random phases of Eq. 5, at a pace [m/s]."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, (draws, SINES)).tolist()
    return [PathFollowing(hand=MultiSineHand(phases=tuple(row)), pace=pace) for row in phases]


def solve_table() -> dict[str, dict[str, float]]:
    """Solve the damper of each of the paper's controllers at each pace, to four digits."""
    return {
        name: {pace: float(f"{damping_for_pace(kind(), speed):.4g}") for pace, speed in PACES.items()}
        for name, kind in CONTROLLERS.items()
        if issubclass(kind, Impedance)
    }


def _mean_pace(controller: Impedance, tasks: list[PathFollowing]) -> float:
    batch = Batch(BASELINE, tasks)
    telemetry = simulate(batch, bind(controller, BASELINE, batch), [0] * len(tasks), max(map(time_limit, tasks)))
    return float(score_episodes(telemetry, tasks)["mean_pace_m_s"].mean())
