"""Control laws: an observation in, four clutch voltages out."""

from pter_gym._compiled.compiler import compiled
from pter_gym._compiled.records import rows
from pter_gym._internal.laws import LAWS
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers._gains import MEMORY, Memory
from pter_gym.controllers._guided import (
    Guided,
    Impedance,
    PaceSchedule,
    SingleDof,
    TorqueFeedback,
    VelocityRatio,
)
from pter_gym.controllers._policy import AnyPolicy, Controller, Policy, bind
from pter_gym.controllers._scaled import Powers, Scaled
from pter_gym.controllers._simple import Free, Locked, Random

CONTROLLERS: dict[str, type[Controller]] = {name: globals()[kind] for name, kind in LAWS.items()}
"""The built-in controllers by name."""

__all__ = [
    "CONTROLLERS",
    "MEMORY",
    "AnyPolicy",
    "Controller",
    "Free",
    "Guided",
    "Impedance",
    "Locked",
    "Memory",
    "PaceSchedule",
    "PerClutch",
    "Policy",
    "Powers",
    "Random",
    "Scaled",
    "SingleDof",
    "TorqueFeedback",
    "VelocityRatio",
    "bind",
    "compiled",
    "rows",
]
