"""The reward: each term is declared once, as a field of ``RewardWeights``, with its weight and how it is found.

The terms of the telemetry, their sum and the hyper-parameters of a training follow from there.
"""

from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Annotated, Any, NamedTuple

from pter_gym.compiled.compiler import device
from pter_gym.compiled.records import Entry, written
from pter_gym.params import quantity, require_number
from pter_gym.physics.clutch import PerClutch
from pter_gym.physics.step import Energy
from pter_gym.tasks.path_following.situation import Situation

ERROR_UNIT = 0.01
ACCELERATION_UNIT = 10.0


class Outcome(NamedTuple):
    """What a control step has led to.

    Attributes
    ----------
    at
        Where the tip is with respect to the path.
    pace
        Commanded pace [m/s].
    acceleration
        Of the tip, mean over the control step [m/s²].
    volts, voltage_max
        Voltages and their limit [V].
    energy
        What the hand and the clutches did in the control step [J].
    failed
        Whether the tip has left the workspace.
    """

    at: Situation
    pace: float
    acceleration: float
    volts: PerClutch
    voltage_max: float
    energy: Energy
    failed: bool


Find = Callable[[float, Outcome, float], float]


def term(unit: str, provenance: str, find: Find, *, default: float, absent: Any = MISSING) -> Any:
    """Declare a term of the reward, which is never positive.

    Parameters
    ----------
    unit, provenance, default, absent
        Of its weight; see ``quantity``. A term that is new has ``absent=0.0``.
    find
        From the weight, what a control step has led to and its period [s] to the term; it is compiled.
    """
    declared = quantity(unit, provenance, absent=absent).metadata
    return field(default=default, metadata={**declared, "find": device(find)})


@device
def mean_square(volts: PerClutch) -> float:
    """Return the mean squared voltage [V²]."""
    return 0.25 * (volts.x1 * volts.x1 + volts.x2 * volts.x2 + volts.x3 * volts.x3 + volts.x4 * volts.x4)


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weights of the reward terms, each a rate per second; the reward is never positive."""

    error: float = term(
        "1/s",
        f"chosen: per {1000 * ERROR_UNIT:g} mm of distance from the path",
        lambda weight, seen, period: -period * weight * abs(seen.at.normal_error) / ERROR_UNIT,
        default=1.0,
    )
    pace: float = term(
        "1/s",
        "chosen: per 100 % of deviation from the commanded pace",
        lambda weight, seen, period: -period * weight * abs(seen.at.speed.along - seen.pace) / seen.pace,
        default=1.0,
    )
    acceleration: float = term(
        "1/s",
        f"chosen: per {ACCELERATION_UNIT:g} m/s² of tip acceleration",
        lambda weight, seen, period: -period * weight * seen.acceleration / ACCELERATION_UNIT,
        default=0.1,
    )
    effort: float = term(
        "1/s",
        "chosen: per mean of the squared voltages, relative to the largest",
        lambda weight, seen, period: -period * weight * mean_square(seen.volts) / (seen.voltage_max * seen.voltage_max),
        default=0.1,
    )
    failure: float = term(
        "1",
        "chosen: once, on leaving the workspace",
        lambda weight, seen, period: -weight if seen.failed else 0.0,  # noqa: ARG005
        default=100.0,
    )

    def __post_init__(self) -> None:
        """Check that no weight is negative."""
        for item in fields(self):
            require_number(self, item.name, at_least=0.0)


WEIGHTS: tuple[Field[Any], ...] = fields(RewardWeights)
"""The weights, in the order of the terms."""


def weighted(weight: Field[Any]) -> Any:
    """Return the type of a term: a number with the unit of its weight, and what that is per."""
    told = weight.metadata
    return Annotated[float, Entry(told["unit"], "{}: " + told["provenance"].removeprefix("chosen: "))]


_TERMS = [(item.name, weighted(item)) for item in WEIGHTS]
Terms = NamedTuple("Terms", _TERMS)
"""One number for each term of the reward."""


def _in_turn() -> Any:
    """Return ``reward_terms(weight, seen, period)``: the terms of a control step of ``period`` [s], each weighed."""
    names = {f"find_{item.name}": item.metadata["find"] for item in WEIGHTS}
    found = (f"find_{item.name}(weight.{item.name}, seen, period)" for item in WEIGHTS)
    return device(written("weight, seen, period", [f"return Terms({', '.join(found)})"], {**names, "Terms": Terms}))


reward_terms = _in_turn()


@device
def total(terms: Any) -> float:
    """Return the sum of the terms."""
    found = terms[0]
    for k in range(1, len(terms)):
        found += terms[k]
    return found
