"""The reward: its terms, their weights and how each is found. Weights, telemetry and the sum follow from here."""

from collections import namedtuple
from dataclasses import dataclass, fields
from typing import Annotated, Any, NamedTuple

from pter_gym.compiled.compiler import device
from pter_gym.compiled.records import Entry
from pter_gym.params import quantity, require_number
from pter_gym.physics.clutch import PerClutch

ERROR_UNIT = 0.01
ACCELERATION_UNIT = 10.0


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weights of the reward terms, each a rate per second; the reward is never positive."""

    error: float = quantity("1/s", f"chosen: per {1000 * ERROR_UNIT:g} mm of distance from the path", default=1.0)
    pace: float = quantity("1/s", "chosen: per 100 % of deviation from the commanded pace", default=1.0)
    acceleration: float = quantity("1/s", f"chosen: per {ACCELERATION_UNIT:g} m/s² of tip acceleration", default=0.1)
    effort: float = quantity("1/s", "chosen: per mean of the squared voltages, relative to the largest", default=0.1)
    failure: float = quantity("1", "chosen: once, on leaving the workspace", default=100.0)

    def __post_init__(self) -> None:
        """Check that no weight is negative."""
        for item in fields(self):
            require_number(self, item.name, at_least=0.0)


def weighted(unit: str, provenance: str) -> Entry:
    """Return what a record of terms says of one whose weight has a unit and a provenance."""
    return Entry(unit, "{}: " + provenance.removeprefix("chosen: "))


Terms: Any = namedtuple("Terms", [item.name for item in fields(RewardWeights)])
"""One number for each term of the reward, in the order of ``RewardWeights``."""

Terms.__annotations__ = {item.name: Annotated[float, weighted(**item.metadata)] for item in fields(RewardWeights)}


class Outcome(NamedTuple):
    """What a control step has led to, as far as the reward asks.

    Attributes
    ----------
    normal_error, speed_along, pace
        Distance from the path [m], speed along it and commanded pace [m/s].
    acceleration
        Of the tip, mean over the control step [m/s²].
    volts, voltage_max
        Voltages and their limit [V].
    failed
        Whether the tip has left the workspace.
    """

    normal_error: float
    speed_along: float
    pace: float
    acceleration: float
    volts: PerClutch
    voltage_max: float
    failed: bool


@device
def reward_terms(weight: Any, seen: Outcome, period: float) -> Any:
    """Return the terms of a control step of ``period`` [s], each with its weight. None is positive."""
    volts = seen.volts
    mean_square = 0.25 * (volts.x1 * volts.x1 + volts.x2 * volts.x2 + volts.x3 * volts.x3 + volts.x4 * volts.x4)
    return Terms(
        error=-period * weight.error * abs(seen.normal_error) / ERROR_UNIT,
        pace=-period * weight.pace * abs(seen.speed_along - seen.pace) / seen.pace,
        acceleration=-period * weight.acceleration * seen.acceleration / ACCELERATION_UNIT,
        effort=-period * weight.effort * mean_square / (seen.voltage_max * seen.voltage_max),
        failure=-weight.failure if seen.failed else 0.0,
    )


@device
def total(terms: Any) -> float:
    """Return the sum of the terms."""
    found = terms[0]
    for k in range(1, len(terms)):
        found += terms[k]
    return found
