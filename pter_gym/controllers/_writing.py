"""What users need to write a control law."""

from pter_gym._compiled.compiler import compiled
from pter_gym._compiled.records import rows
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
from pter_gym.controllers._laws import Tip, pace_integral, speed_along

__all__ = [
    "MEMORY",
    "Gains",
    "Memory",
    "Nominal",
    "PerClutch",
    "PerLink",
    "Tip",
    "allocate",
    "clutch_voltage",
    "compiled",
    "joint_torque",
    "pace_integral",
    "passive_torques",
    "rows",
    "speed_along",
    "table_voltage",
]
