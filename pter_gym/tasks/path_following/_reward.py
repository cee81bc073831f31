"""The reward: each term is declared once, as a field of ``RewardWeights``, with its weight and its function.

The telemetry's reward terms, their sum and the training hyper-parameters are derived from these.
"""

import math
from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.compiler import device
from pter_gym._compiled.generated import compile_source
from pter_gym._compiled.records import Entry
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.step import Energy
from pter_gym.params import quantity, require_number
from pter_gym.tasks.path_following._situation import Situation

ERROR_WIDTH = 0.06
"""Distance from the path [m] at which tracking pays 1/e of what it pays on the path."""

PRECISION_WIDTH = 0.006
"""The same for precision: a few times the mean error of a ranked policy."""

PACE_WINDOW = 0.1
"""Time constant [s] of the mean of the pace that is judged: about the lag of the clutches."""

FASTEST = 50.0
"""Ratio to the commanded pace beyond which a pace costs no more."""

PERFECT = 1000.0
"""What the whole path at the commanded pace and without error pays."""

REST = 5.0
"""What rest costs over what twice the pace costs: an episode lasts two path times longer than a ride at the commanded
pace, and who rests so long loses ``PERFECT``, so whoever stops for ever, however late, has earned nothing."""

ACCELERATION_UNIT = 10.0


class Outcome(NamedTuple):
    """The outcome of a control step.

    Attributes
    ----------
    at
        Position of the tip relative to the path.
    advance
        Progress of the tip beyond the previous largest arc length [m].
    reached
        The largest arc length so far [m].
    path_length
        Length of the path [m].
    pace
        Commanded pace [m/s].
    pace_ratio
        Rate of change of the arc length over the commanded pace, averaged over about ``PACE_WINDOW``.
    acceleration
        Mean acceleration of the tip over the control step [m/s²].
    volts, last_volts, voltage_max
        Voltages of this control step and the previous one, and their limit [V].
    energy
        Work of the hand and the clutches in the control step [J].
    failed
        Whether the tip has left the workspace or missed the end of the path.
    """

    at: Situation
    advance: float
    reached: float
    path_length: float
    pace: float
    pace_ratio: float
    acceleration: float
    volts: PerClutch
    last_volts: PerClutch
    voltage_max: float
    energy: Energy
    failed: bool


Find = Callable[[float, Outcome, float], float]


def term(unit: str, provenance: str, find: Find, *, default: float) -> Any:
    """Declare a term of the reward.

    Parameters
    ----------
    unit, provenance, default
        Unit, provenance and default of its weight; see ``quantity``. Stored tasks that lack a term use its default.
    find
        Function from the weight, the outcome of a control step and its period [s] to the term; it is compiled.
    """
    return field(default=default, metadata={**quantity(unit, provenance).metadata, "find": device(find)})


@device
def mean_square(volts: PerClutch) -> float:
    """Return the mean squared voltage [V²]."""
    return 0.25 * (volts.x1 * volts.x1 + volts.x2 * volts.x2 + volts.x3 * volts.x3 + volts.x4 * volts.x4)


@device
def pace_share(ratio: float) -> float:
    """Return the share of the pay that a pace earns, from its ratio to the commanded one: 1 at ratio 1, else less."""
    slower = ratio if ratio > 0.0 else 0.0
    square = ratio * ratio
    return slower * square if ratio < 1.0 else 1.0 / (square * square)


@device
def paid(weight: float, seen: Outcome, width: float) -> float:
    """Return the pay for new arc length; ``width`` is the distance from the path [m] at which it is 1/e."""
    near = math.exp(-abs(seen.at.normal_error) / width)
    return weight * seen.advance / seen.path_length * pace_share(seen.pace_ratio) * near


@device
def pace_cost(ratio: float) -> float:
    """Return the cost of a pace, from its ratio to the commanded one: its distance from 1, times ``REST`` if slower."""
    slower = ratio if ratio > 0.0 else 0.0
    faster = ratio if ratio < FASTEST else FASTEST
    return REST * (1.0 - slower) if ratio < 1.0 else faster - 1.0


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weights of the reward terms."""

    tracking: float = term(
        "1",
        "chosen: for the whole path at the commanded pace without error",
        lambda weight, seen, period: paid(weight, seen, ERROR_WIDTH),  # noqa: ARG005
        default=PERFECT,
    )
    precision: float = term(
        "1",
        "chosen: for the whole path at the commanded pace without error; next to nothing 30 mm beside it",
        lambda weight, seen, period: paid(weight, seen, PRECISION_WIDTH),  # noqa: ARG005
        default=0.0,
    )
    pace: float = term(
        "1",
        f"chosen: at twice the commanded pace, in one path time; {REST:g} times as much at rest",
        lambda weight, seen, period: -weight * pace_cost(seen.pace_ratio) * seen.pace * period / seen.path_length,
        default=0.1 * PERFECT,
    )
    acceleration: float = term(
        "1/s",
        f"chosen: per {ACCELERATION_UNIT:g} m/s² of tip acceleration",
        lambda weight, seen, period: -period * weight * seen.acceleration / ACCELERATION_UNIT,
        default=0.0,
    )
    effort: float = term(
        "1/s",
        "chosen: per mean of the squared voltages, relative to the largest",
        lambda weight, seen, period: -period * weight * mean_square(seen.volts) / (seen.voltage_max * seen.voltage_max),
        default=0.0,
    )
    failure: float = term(
        "1",
        "chosen: on leaving the workspace or missing the end of the path, times the part of it that was reached",
        lambda weight, seen, period: -weight * seen.reached / seen.path_length if seen.failed else 0.0,  # noqa: ARG005
        default=PERFECT,
    )

    def __post_init__(self) -> None:
        """Check that no weight is negative."""
        for item in fields(self):
            require_number(self, item.name, at_least=0.0)


WEIGHTS: tuple[Field[Any], ...] = fields(RewardWeights)
"""The weights, in the order of the terms."""


def weighted(weight: Field[Any]) -> Any:
    """Return the type of a term: a number with its weight's unit and meaning."""
    told = weight.metadata
    return Annotated[float, Entry(told["unit"], "{}: " + told["provenance"].removeprefix("chosen: "))]


_TERMS = [(item.name, weighted(item)) for item in WEIGHTS]
Terms = NamedTuple("Terms", _TERMS)
"""One number for each term of the reward."""


def _in_turn() -> Any:
    """Return ``reward_terms(weight, seen, period)``: the weighted terms of a control step of ``period`` [s]."""
    names = {f"find_{item.name}": item.metadata["find"] for item in WEIGHTS}
    found = ", ".join(f"find_{item.name}(weight.{item.name}, seen, period)" for item in WEIGHTS)
    source = f"def reward_terms(weight, seen, period):\n    return Terms({found})\n"
    return device(compile_source(source, "reward_terms", {**names, "Terms": Terms}))


reward_terms = _in_turn()


@device
def total(terms: Any) -> float:
    """Return the sum of the terms."""
    found = terms[0]
    for k in range(1, len(terms)):
        found += terms[k]
    return found
