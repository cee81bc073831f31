"""What bounds the path error of a law on the paper's line: torque, lag, or that clutches cannot push.

Each is changed by itself and with the others. The law knows the changed torque curve, as it knows that of the true
clutches. A law's gains were tuned for the true clutches, so ``adapted`` searches near them for each kind of actuator.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from studies.motors import on_motors, simulate_motors

from pter_gym.benchmark.measures import column, four
from pter_gym.benchmark.metrics import ranked_scores, score_episodes
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.benchmark.recorded import Travel
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.benchmark.statistics import Interval, bootstrap_interval, interquartile_mean
from pter_gym.controllers import Guided, Impedance, SingleDof
from pter_gym.engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, TIME_CONSTANT, Machine, quantity, require_flag, require_number
from pter_gym.scenarios import find_pace, find_scenario
from pter_gym.tasks.path_following import PathFollowing

Array = NDArray[np.float64]

DRAWS = 64
"""Training draws of ``standard`` behind each number."""

SEED = 5000
"""Seed of the first of these draws; the others follow."""

SEARCH_DRAWS = 24
"""Draws of each trial when gains are adapted; they come before ``SEED``."""

NO_LAG = 1e-9
"""Time constant [s] of an actuator without lag: nothing is left of it after a substep."""

POPULATION = 40
"""Members of the search for adapted gains, and trials of each of its generations."""

GENERATIONS = 5

SPREAD = 1.5
"""Standard deviation of the logarithm of a gain, over the law's own, in the first generation."""

REACH = 5.0
"""Largest change of the logarithm of a gain."""

MARGIN = 0.9
"""Part of the leaderboard's limits on the pace that adapted gains may use on the draws of the search."""

PACE_ERRORS = ("mean_pace_error", "segment_pace_error")

SEARCHED: Mapping[type[Guided], tuple[str, ...]] = MappingProxyType(
    {
        Impedance: ("stiffness", "damping_normal", "damping_tangential", "pace_integral"),
        SingleDof: ("approach", "strength", "lead", "feedback", "damping_tangential", "pace_integral"),
    }
)
"""Which gains are searched, by law."""


@dataclass(frozen=True, kw_only=True)
class Actuators:
    """What is in the clutches' places."""

    pushes: bool = quantity("1", "chosen: motors, whose torque may have any sign", default=False)
    time_constant: float = quantity("s", "published: section IV-C.3; 0 is no lag", default=TIME_CONSTANT)
    torque: float = quantity("1", "chosen: torques over those of the present clutches", default=1.0)

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_flag(self, "pushes")
        require_number(self, "time_constant", at_least=0.0)
        require_number(self, "torque", above=0.0)

    @property
    def machine(self) -> Machine:
        """The baseline machine with such clutches, whose torques the motors have too."""
        clutch = BASELINE.clutch
        changed = replace(
            clutch,
            breakaway=clutch.breakaway.scaled(self.torque),
            dynamic=clutch.dynamic.scaled(self.torque),
            time_constant=self.time_constant or NO_LAG,
        )
        return replace(BASELINE, clutch=changed)


CLUTCHES = Actuators()
"""The true ones."""


@dataclass(frozen=True)
class Outcome:
    """A law on one kind of actuator at one pace.

    Attributes
    ----------
    path_error
        Interquartile mean over the draws with its 95 % interval [m].
    completed, mean_pace_error, segment_pace_error, saturated
        Means of these scores.
    mean_pace
        Mean over the draws [m/s].
    pushing
        Fraction of the control instants at which an actuator drives the arm; 0 for clutches.
    """

    path_error: Interval
    completed: float
    mean_pace_error: float
    segment_pace_error: float
    saturated: float
    mean_pace: float
    pushing: float

    @property
    def shortfall(self) -> float:
        """By how much it misses the leaderboard's limits on arrivals and pace, added up; 0 with a rank."""
        errors = (self.mean_pace_error, self.segment_pace_error)
        return max(COMPLETION - self.completed, 0.0) + sum(max(error - PACE_ERROR, 0.0) for error in errors)


@cache
def drawn_task(pace: str) -> PathFollowing:
    """Return the task of ``standard`` at a pace; its draws differ by the seed of the reset alone."""
    scenario = find_scenario("standard")
    return scenario.randomisation(find_pace(pace), contexts=1).pairs()[0][1]


@cache
def _batch(machine: Machine, pace: str, draws: int) -> Batch:
    return Batch(machine, drawn_task(pace), draws)


def try_out(controller: Guided, actuators: Actuators, pace: str, *, draws: int = DRAWS, seed: int = SEED) -> Outcome:
    """Return how a law does on some actuators.

    Parameters
    ----------
    controller
        Its gains; on motors, impedance control without a torque loop.
    actuators
        What it acts with; it knows their torque curve.
    pace
        Name of the commanded pace.
    draws, seed
        Number of training draws, and the seed of the first one.

    Raises
    ------
    ParameterError
        If the law cannot do without the passive constraint.
    """
    task = drawn_task(pace)
    telemetry = _run(controller, actuators, pace, range(seed, seed + draws), time_limit(task))
    steps = telemetry[1:]
    drives = (four(steps, "power") > 0.0).any(axis=-1)
    scores = score_episodes(telemetry, [task] * draws)
    means = ("completed", "mean_pace_error", "segment_pace_error", "saturated", "mean_pace_m_s")
    return Outcome(
        bootstrap_interval(scores["path_error_m"]),
        *(float(scores[name].mean()) for name in means),
        pushing=float(drives.sum() / np.isfinite(column(steps, "time")).sum()),
    )


def _run(controller: Guided, actuators: Actuators, pace: str, seeds: range, limit: int) -> Array:
    """Return the telemetry until the last episode has ended, after ``limit`` control steps at most."""
    machine = actuators.machine
    batch = _batch(machine, pace, len(seeds))
    if not actuators.pushes:
        telemetry = simulate(batch, controller.bind(machine, batch.layout), seeds, limit)
    elif isinstance(controller, Impedance):
        telemetry = simulate_motors(batch, on_motors(controller, machine, batch.layout), seeds, limit)
    else:
        raise ParameterError(f"controller must be Impedance where actuators push, got {type(controller).__name__}")
    return telemetry[: int(np.isfinite(column(telemetry, "time")).any(axis=1).sum())]


def adapted(controller: Guided, actuators: Actuators, pace: str, *, draws: int = SEARCH_DRAWS) -> Guided:
    """Return the law with gains that suit the actuators, from a small search about its own.

    Differential evolution of the logarithms of the gains in ``SEARCHED``, from the law's own and others about them.
    Better is a smaller path error, and 1 m for each unit by which episodes do not arrive, or the pace errors exceed
    ``MARGIN`` of the leaderboard's limits. The draws are not those of ``try_out``.

    Parameters
    ----------
    controller, actuators, pace
        As in ``try_out``.
    draws
        Number of training draws of each trial.
    """
    names = SEARCHED[type(controller)]
    rng = np.random.default_rng(SEED)

    def changed(logarithms: Array) -> Guided:
        factors = np.exp(logarithms).tolist()
        return replace(
            controller, **{name: f * getattr(controller, name) for name, f in zip(names, factors, strict=True)}
        )

    def cost(logarithms: Array) -> float:
        return _cost(changed(logarithms), actuators, pace, draws)

    shape = POPULATION, len(names)
    members = np.clip(SPREAD * rng.standard_normal(shape) * (rng.random(shape) < 0.5), -REACH, REACH)
    members[0] = 0.0
    found = cast(Any, optimize).differential_evolution(
        cost,
        [(-REACH, REACH)] * len(names),
        strategy="currenttobest1bin",
        init=members,
        mutation=(0.3, 0.9),
        recombination=0.8,
        maxiter=GENERATIONS,
        tol=0.0,
        polish=False,
        rng=rng,
    )
    return changed(found.x)


def _cost(controller: Guided, actuators: Actuators, pace: str, draws: int) -> float:
    limit = time_limit(drawn_task(pace)) // 2  # who is later than that has missed the pace by far
    telemetry = _run(controller, actuators, pace, range(SEED - draws, SEED), limit)
    columns = (column(telemetry, name) for name in ("time", "arc_length", "normal_error", "is_success"))
    scores = ranked_scores(Travel(*columns, [drawn_task(pace)] * draws))
    off = sum(max(float(scores[name].mean()) - MARGIN * PACE_ERROR, 0.0) for name in PACE_ERRORS)
    return float(interquartile_mean(scores["path_error_m"])) + 1.0 - float(scores["completed"].mean()) + off
