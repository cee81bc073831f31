"""The commanded paces, and the paper's gains at each: only the damper along the path changes, which sets the pace.

The gains were made for about 0.5 m/s. ``damping_for_pace`` solves for the damper at a commanded pace on a scenario's
training draws, which never include evaluation episodes; ``docs/make/store.py paces`` writes the table.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

from pter_gym._engine.batch import Batch
from pter_gym.benchmark._recorded import Recorded
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.controllers import Impedance, PaceSchedule, TorqueFeedback
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario

TABLE = Path(__file__).parents[1] / "presets" / "paces.toml"

DRAWS, SEED = 64, 5
"""Number and seed of the training draws on which the damper is solved."""

LOWEST, HIGHEST = 10.0, 3000.0
"""Range of the search [N·s/m]."""

HOLD = 1e-6
"""Fraction of a commanded pace about it in which its damper holds: far more than the rounding of a float32."""


def paced(controller: Impedance, dampers: Mapping[str, float]) -> PaceSchedule:
    """Return a controller whose damper along the path [N·s/m] follows the commanded pace, given for paces by name."""
    knots = [(PACES[pace], replace(controller, damping_tangential=damping)) for pace, damping in dampers.items()]
    return PaceSchedule(tuple(sorted(knots, key=lambda knot: knot[0])), hold=HOLD)


@cache
def damping_table() -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    """Return the damper along the path [N·s/m] by scenario, controller and pace."""
    return MappingProxyType(tomllib.loads(TABLE.read_text(encoding="utf-8")))


def damping_for_pace(controller: Impedance, pace: float, scenario: str = "standard", *, draws: int = DRAWS) -> float:
    """Return the damper along the path [N·s/m] with which a controller keeps a pace on training draws.

    If no damper from 10 to 3000 N·s/m gives that pace, the nearer end of this range is returned.

    Parameters
    ----------
    controller
        Its other gains are kept.
    pace
        Commanded mean speed along the path [m/s]. It applies after the first segment, which contains the start-up.
    scenario
        Name of the scenario.
    draws
        Number of the training draws over which the pace is averaged.
    """
    machines, tasks = zip(*find_scenario(scenario).randomisation(pace, contexts=draws, seed=SEED).pairs(), strict=True)
    batch = Batch(machines, tasks)
    low, high = math.log(LOWEST), math.log(HIGHEST)
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        if _cruising_pace(replace(controller, damping_tangential=math.exp(middle)), batch) > pace:
            low = middle
        else:
            high = middle
    return math.exp(0.5 * (low + high))


def solve_table() -> dict[str, dict[str, dict[str, float]]]:
    """Solve for the damper of each of the paper's controllers, scenario and pace, to four digits."""
    laws = {"impedance": Impedance(), "torque-feedback": TorqueFeedback()}
    return {
        scenario: {
            name: {pace: float(f"{damping_for_pace(law, speed, scenario):.4g}") for pace, speed in PACES.items()}
            for name, law in laws.items()
        }
        for scenario in SCENARIOS
    }


def _cruising_pace(controller: Impedance, batch: Batch) -> float:
    tasks = [task for _, task in batch.pairs]
    telemetry = simulate(batch, controller, range(len(tasks)), max(map(time_limit, tasks)))
    return float(Recorded(telemetry, tasks, BASELINE.clutch.voltage_max).cruising_pace().mean())
