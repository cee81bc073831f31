"""How many of the paper's claims one machine can meet: a search with all of them in its objective.

    python benchmarks/compromise.py [--minutes 10] [--seed 1] [--step 0.02]

CMA-ES begins with the study's machine, whose own search weighed some of the claims and left out
others. A claim that is not met costs 1, and up to 1 more the further it is from its bounds. Prints
each better machine, then the claims that the best one does not meet, and its numbers. On one core;
needs the extra ``tune``.
"""

import copy
import json
import math
import time
from collections.abc import Iterable
from operator import itemgetter
from typing import Any

import cmaes
import numpy as np
import tyro
from numpy.typing import NDArray

from pter_gym.controllers import TorqueFeedback
from pter_gym.errors import ParameterError
from pter_gym.hands import eq5
from pter_gym.params._files import machine_from
from pter_gym.params._named import paper_machines
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tools.paper.claims import STATEMENTS, Claim, Statement, check
from pter_gym.tools.paper.experiments import Experiments
from pter_gym.tools.paper.parameters import STUDY, Setup
from pter_gym.tools.tuning.laws import Range

SPACE = {
    **{f"machine.arm.length_{link}": Range(0.3, 0.66) for link in "ab"},
    **{f"machine.arm.inertia_{link}": Range(0.25, 2.0) for link in "ab"},
    "machine.arm.coupling": Range(-0.42, 0.42),
    "machine.slip_threshold": Range(0.001, 0.03),
    "machine.clutch.dynamic.slope": Range(0.6, 1.6),
    "machine.clutch.dynamic.knee": Range(8.0, 22.0),
    "machine.clutch.dynamic.curvature": Range(0.1, 4.0),
    "delrin.breakaway_ratio": Range(1.12, 1.5),
    "delrin.delrin_scale": Range(0.5, 0.95),
    "delrin.delrin_ratio": Range(1.12, 1.8),
    "delrin.mu_dynamic": Range(0.37, 0.45),
    "path.x": Range(-0.6, 0.6),
    "path.y": Range(0.3, 1.1),
    "path.length": Range(0.4, 1.2),
    "hand.push": Range(20.0, 90.0),
    "hand.force_max": Range(5.0, 98.0),
    "controller.stiffness": Range(100.0, 3000.0),
    "controller.damping_normal": Range(5.0, 400.0),
    "controller.damping_tangential": Range(10.0, 400.0),
    "controller.slip_threshold": Range(0.001, 0.1),
    "runs.table_error": Range(0.7, 1.4),
    "runs.delrin_table": Range(0.5, 1.5),
    "runs.time_constant_max": Range(0.15, 0.25),
}
"""Numbers of ``study.toml`` and the ranges of the calibration, or about those."""

LATER = {
    *("trend_over_gain", "plateau_width", "saturation_begins", "best_gain"),
    *("line_following_ratio", "peak_share", "weakest_slips"),
}
"""Measures of experiments that are left out where the others are already too bad."""

SCALE = 0.1
"""Distance from its only bound at which a claim costs 2; with two bounds, it is their distance."""

REFUSED = 2.0 * len(STATEMENTS)
"""Cost of a machine that cannot do the task."""


def study_of(point: NDArray[np.float64]) -> dict[str, Any]:
    """Return the study with the numbers of a point of the unit cube, of four digits."""
    study = copy.deepcopy(STUDY)
    for (place, space), share in zip(SPACE.items(), point.tolist(), strict=True):
        *tables, name = place.split(".")
        table = study
        for each in tables:
            table = table[each]
        table[name] = float(f"{space.at(share):.4g}")
    clutch = study["machine"]["clutch"]
    for name in ("slope", "knee", "curvature"):
        ratio = 1.0 if name == "knee" else study["delrin"]["breakaway_ratio"]
        clutch["breakaway"][name] = ratio * clutch["dynamic"][name]
    return study


def start() -> NDArray[np.float64]:
    """Return the point of the study itself."""
    numbers: dict[str, float] = {}
    for place in SPACE:
        value: Any = STUDY
        for name in place.split("."):
            value = itemgetter(name)(value)
        numbers[place] = value
    return np.clip([space.share(numbers[place]) for place, space in SPACE.items()], 0.0, 1.0)


def experiments_of(study: dict[str, Any]) -> Experiments:
    """Return the paper's experiments on a study's machine."""
    lag = study["runs"].pop("time_constant_max")
    controller = dict(study["controller"], table_volts=tuple(study["controller"]["table_volts"]))
    return Experiments(
        Setup(
            machines=paper_machines(machine_from(study["machine"]), **study["delrin"]),
            task=PathFollowing(path=Line(**study["path"]), hand=eq5(**study["hand"])),
            controller=TorqueFeedback(**controller),
            time_constants=tuple(round(lag * k / 20, 6) for k in range(1, 21)),
            **study["runs"],
        )
    )


def cost(claims: Iterable[Claim]) -> float:
    """Return how many claims are not met, and more the further they are from it."""
    return math.fsum(1.0 + min(_beyond(each), 1.0) for each in claims if not each.holds)


def _beyond(claim: Claim) -> float:
    """Return how far a claim is from its bounds, over their distance or ``SCALE``."""
    low, high = claim.statement.at_least, claim.statement.at_most
    if not math.isfinite(claim.value):
        return 1.0
    width = high - low if math.isfinite(high - low) else SCALE
    return max(low - claim.value, claim.value - high) / width


def judge(point: NDArray[np.float64], limit: float = math.inf) -> float:
    """Return the cost of a point; beyond a limit that of its first experiments, and more."""
    first, later = list[Statement](), list[Statement]()
    for each in STATEMENTS:
        (later if each.measure in LATER else first).append(each)
    try:
        experiments = experiments_of(study_of(point))
        found = cost(check(experiments, first))
        return found + (len(later) if found > limit else cost(check(experiments, later)))
    except ParameterError:
        return REFUSED


def main(minutes: float = 10.0, seed: int = 1, step: float = 0.02) -> None:
    """Search for so many minutes of processor time."""
    best = start()
    least = judge(best)
    print(f"the study: {least:.3f}", flush=True)
    bounds = np.array([[0.0, 1.0]] * len(SPACE))
    search = cmaes.CMA(mean=best, sigma=step, bounds=bounds, seed=seed)
    candidates = 0
    while time.process_time() < 60.0 * minutes:
        asked = [search.ask() for _ in range(search.population_size)]
        told = [(point, judge(point, least + 1.0)) for point in asked]
        search.tell(told)
        candidates += len(told)
        point, value = min(told, key=itemgetter(1))
        if value < least:
            best, least = point, value
            print(f"{candidates} candidates: {least:.3f}", flush=True)
    study = study_of(best)
    print(f"{candidates} candidates, the best of which does not meet")
    for each in check(experiments_of(copy.deepcopy(study))):
        if not each.holds:
            print(f"    {each.statement.id}: {each.value:.4g}, needed {each.statement.condition}")
    print(json.dumps({table: study[table] for table in study if table != "machine"}))
    print(json.dumps(study["machine"]))


if __name__ == "__main__":
    tyro.cli(main)
