"""Control laws: an observation in, four clutch voltages out."""

from pkgutil import resolve_name

from pter_gym._compiled.compiler import compiled
from pter_gym._compiled.records import rows
from pter_gym._internal.laws import LAWS
from pter_gym._physics.arm import PerLink, joint_torque
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers._allocation import allocate, passive_torques
from pter_gym.controllers._gains import (
    MEMORY,
    Gains,
    Memory,
    Nominal,
    clutch_voltage,
    table_voltage,
)
from pter_gym.controllers._guided import Guided, Impedance, PaceSchedule, TorqueFeedback
from pter_gym.controllers._laws import Tip, pace_integral, speed_along
from pter_gym.controllers._policy import AnyPolicy, Controller, Policy, bind
from pter_gym.controllers._scaled import Powers, Scaled
from pter_gym.controllers._simple import Free, Locked, Random
from pter_gym.controllers._steering import SingleDof, VelocityRatio

CONTROLLERS: dict[str, type[Controller]] = {
    name: resolve_name(f"{__name__}.{place}") for name, place in LAWS.items()
}
"""The built-in controllers by name."""

__all__ = [
    "CONTROLLERS",
    "MEMORY",
    "AnyPolicy",
    "Controller",
    "Free",
    "Gains",
    "Guided",
    "Impedance",
    "Locked",
    "Memory",
    "Nominal",
    "PaceSchedule",
    "PerClutch",
    "PerLink",
    "Policy",
    "Powers",
    "Random",
    "Scaled",
    "SingleDof",
    "Tip",
    "TorqueFeedback",
    "VelocityRatio",
    "allocate",
    "bind",
    "clutch_voltage",
    "compiled",
    "joint_torque",
    "pace_integral",
    "passive_torques",
    "rows",
    "speed_along",
    "table_voltage",
]
