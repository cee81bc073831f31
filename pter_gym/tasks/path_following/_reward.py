"""The reward of path following: its terms, and what an outcome of a control step pays."""

import math
from dataclasses import Field, dataclass, fields
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry
from pter_gym._internal.fields import Checked, parameter
from pter_gym._physics.clutch import PerClutch
from pter_gym.tasks.path_following._position import PathState

ERROR_WIDTH = 0.06
"""Distance from the path [m] at which tracking pays 1/e of what it pays on the path."""

PRECISION_WIDTH = 0.006
"""The same for precision: a few times the mean error of a ranked policy."""

PACE_WINDOW = 0.1
"""Time constant [s] of the mean of the pace that is judged: about the lag of the clutches."""

MAX_PACE_RATIO = 50.0
"""Ratio to the commanded pace beyond which a pace costs no more."""

PERFECT = 100.0
"""What the whole path at the commanded pace and without error pays."""

REST = 5.0
"""What rest costs over what twice the pace costs: an episode lasts two path times longer than a
rollout at the commanded pace, which costs ``PERFECT``, so a rollout that stops for good, however
late, has earned nothing."""

ACCELERATION_UNIT = 10.0


class Outcome(NamedTuple):
    """The outcome of a control step.

    Attributes
    ----------
    at
        Position of the tip relative to the path.
    advance
        Progress of the tip beyond the previous largest arc length [m].
    earned
        What tracking and precision have paid in earlier control steps.
    path_length
        Length of the path [m].
    pace
        Commanded pace [m/s].
    pace_ratio
        Rate of change of the arc length over the commanded pace, averaged over about
        ``PACE_WINDOW``.
    acceleration
        Mean acceleration of the tip over the control step [m/s²].
    volts, voltage_max
        Voltages of this control step, and their limit [V].
    failed
        Whether the tip has left the workspace or missed the end of the path.
    """

    at: PathState
    advance: float
    earned: float
    path_length: float
    pace: float
    pace_ratio: float
    acceleration: float
    volts: PerClutch
    voltage_max: float
    failed: bool


@inlined
def mean_square(volts: PerClutch) -> float:
    """Return the mean squared voltage [V²]."""
    return 0.25 * (
        volts.x1 * volts.x1 + volts.x2 * volts.x2 + volts.x3 * volts.x3 + volts.x4 * volts.x4
    )


@inlined
def pace_share(ratio: float) -> float:
    """Return the share of the pay that a pace earns, from its ratio to the commanded one."""
    slower = ratio if ratio > 0.0 else 0.0
    square = ratio * ratio
    return slower * square if ratio < 1.0 else 1.0 / (square * square)


@inlined
def paid(weight: float, outcome: Outcome, width: float) -> float:
    """Return the pay for new arc length, which is 1/e at a distance ``width`` from the path [m]."""
    near = math.exp(-abs(outcome.at.normal_error) / width)
    return weight * outcome.advance / outcome.path_length * pace_share(outcome.pace_ratio) * near


@inlined
def pace_cost(ratio: float) -> float:
    """Return the cost of a pace, from its ratio to the commanded one: ``REST`` at rest, 1 at 2.

    Below the commanded pace it is quadratic: were its slope as large there as it is at rest, noise
    of the actions would make it cheaper to be too fast.
    """
    missing = 1.0 - (ratio if ratio > 0.0 else 0.0)
    faster = ratio if ratio < MAX_PACE_RATIO else MAX_PACE_RATIO
    return REST * missing * missing if ratio < 1.0 else faster - 1.0


@dataclass(frozen=True, kw_only=True)
class RewardWeights(Checked):
    """Weights of the reward terms of ``reward_terms``, each ≥ 0.

    Weights that a stored task lacks have their defaults.
    """

    tracking: float = parameter(
        "1",
        "chosen: for the whole path at the commanded pace without error",
        at_least=0.0,
        default=PERFECT,
    )
    precision: float = parameter(
        "1",
        "chosen: for the whole path at the commanded pace without error; next to nothing 30 mm "
        "beside it",
        at_least=0.0,
        default=0.0,
    )
    pace: float = parameter(
        "1",
        f"chosen: at twice the commanded pace, in one path time; {REST:g} times as much at rest",
        at_least=0.0,
        default=0.1 * PERFECT,
    )
    acceleration: float = parameter(
        "1",
        f"chosen: in one path time, per {ACCELERATION_UNIT:g} m/s² of tip acceleration",
        at_least=0.0,
        default=0.0,
    )
    effort: float = parameter(
        "1",
        "chosen: in one path time with all clutches at the largest voltage; in proportion to the "
        "mean square",
        at_least=0.0,
        default=20.0,
    )
    failure: float = parameter(
        "1",
        "chosen: on leaving the workspace or missing the end of the path, times what the episode "
        "has paid for tracking and precision",
        at_least=0.0,
        default=0.5,
    )


def weighted(weight: Field[Any]) -> Any:
    """Return the type of a term: a number with its weight's unit and meaning."""
    told = weight.metadata
    return Annotated[
        float, Entry(told["unit"], "{}: " + told["provenance"].removeprefix("chosen: "))
    ]


_TERMS = [(item.name, weighted(item)) for item in fields(RewardWeights)]
Terms = NamedTuple("Terms", _TERMS)
"""One number for each term of the reward."""


@inlined
def reward_terms(weight: Any, outcome: Outcome, period: float) -> Any:
    """Return the weighted ``Terms`` of a control step of ``period`` [s]."""
    path_times = period * outcome.pace / outcome.path_length
    tracking = paid(weight.tracking, outcome, ERROR_WIDTH)
    precision = paid(weight.precision, outcome, PRECISION_WIDTH)
    earned = outcome.earned + tracking + precision
    strain = mean_square(outcome.volts) / (outcome.voltage_max * outcome.voltage_max)
    return Terms(
        tracking=tracking,
        precision=precision,
        pace=-weight.pace * pace_cost(outcome.pace_ratio) * path_times,
        acceleration=-weight.acceleration * outcome.acceleration / ACCELERATION_UNIT * path_times,
        effort=-weight.effort * strain * path_times,
        failure=-weight.failure * earned if outcome.failed else 0.0,
    )


@inlined
def total(terms: Any) -> float:
    """Return the sum of the terms."""
    found = terms[0]
    for k in range(1, len(terms)):
        found += terms[k]
    return found
