"""Data of the package that a script makes: `python docs/make/store.py episodes|dampers`."""

import math
from dataclasses import replace
from pathlib import Path

import tyro

from pter_gym._internal.files import write_text_atomic
from pter_gym.benchmark import episodes as stored
from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.measures import Recorded
from pter_gym.benchmark.rollout import record_episodes
from pter_gym.controllers import Impedance, TorqueFeedback
from pter_gym.params import BASELINE
from pter_gym.policies import tuned
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario

DAMPERS_HEAD = """\
# Dampers along the path [N·s/m] with which the paper's laws keep the commanded paces on the
# training episodes of each scenario; their other gains are the paper's.
# derived: made by `python docs/make/store.py dampers`.
"""


DRAWS, SEED = 64, 5
"""Number and seed of the training episodes on which the damper is solved."""

MIN_DAMPER, MAX_DAMPER = 10.0, 3000.0
"""Range of the search [N·s/m]."""


def episodes(
    names: tyro.conf.Positional[tuple[str, ...]] = tuple(SCENARIOS), folder: Path = stored.FOLDER
) -> None:
    """Store the test episodes of scenarios, of all by default, in pter_gym/episodes.

    They change every published score: raise the version of a scenario whose episodes change.
    """
    for name in names:
        scenario = find_scenario(name)
        drawn = stored.draw_episodes(scenario)
        path = stored.store_episodes(drawn, version=scenario.version, folder=folder)
        print(
            path.name,
            path.stat().st_size,
            {kind: drawn.strata.count(kind) for kind in sorted(set(drawn.strata))},
        )


def dampers() -> None:
    """Solve the dampers in pter_gym/presets/dampers.toml again, after a change of the physics."""
    text = DAMPERS_HEAD
    for scenario, controllers in solve_table().items():
        for name, by_pace in controllers.items():
            text += f"\n[{scenario}.{name}]\n"
            text += "".join(f"{pace} = {damping!r}\n" for pace, damping in by_pace.items())
    write_text_atomic(tuned.DAMPERS, text)


def damping_for_pace(
    controller: Impedance, pace: float, scenario: str = "standard", *, draws: int = DRAWS
) -> float:
    """Return the damper along the path [N·s/m] with which a controller keeps a pace.

    If no damper from 10 to 3000 N·s/m gives that pace, the nearer end of this range is returned.

    Parameters
    ----------
    controller
        Its other gains are kept.
    pace
        Commanded mean speed along the path [m/s]. It applies after the first segment, which
        contains the start-up.
    scenario
        Name of the scenario.
    draws
        Number of the training episodes over which the pace is averaged.
    """
    pairs = find_scenario(scenario).draws.pairs(draws, SEED, pace)
    machines, tasks = zip(*pairs, strict=True)
    chosen = Episodes(scenario, machines, tasks, tuple(range(draws)), ("",) * draws)
    low, high = math.log(MIN_DAMPER), math.log(MAX_DAMPER)
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        law = replace(controller, damping_tangential=math.exp(middle))
        if _cruising_pace(law, chosen) > pace:
            low = middle
        else:
            high = middle
    return math.exp(0.5 * (low + high))


def solve_table() -> dict[str, dict[str, dict[str, float]]]:
    """Solve for the damper of each paper controller, scenario and pace, to four digits."""
    laws = {"impedance": Impedance(), "torque-feedback": TorqueFeedback()}
    return {
        scenario: {
            name: {
                pace: float(f"{damping_for_pace(law, speed, scenario):.4g}")
                for pace, speed in PACES.items()
            }
            for name, law in laws.items()
        }
        for scenario in SCENARIOS
    }


def _cruising_pace(controller: Impedance, chosen: Episodes) -> float:
    travel = Recorded(
        record_episodes(controller, chosen).telemetry, chosen.tasks, BASELINE.clutch.voltage_max
    )
    return float(travel.mean_pace(first=1).mean())


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({each.__name__: each for each in (episodes, dampers)})
