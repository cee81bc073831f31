"""Parameters of the machine: frozen dataclasses in SI, each field with its unit and provenance."""

from pter_gym.params._connection import PAPER_CLUTCHES, SLOTS, Connection
from pter_gym.params._files import find_machine, find_machines, load_machine, save_machine
from pter_gym.params._machine import Arm, Band, Clutch, Hand, Lag, Machine, TorqueCurve
from pter_gym.params._named import (
    ACTUATORS,
    ARRANGEMENTS,
    BASELINE,
    DELRIN_EXPERIMENTAL,
    DELRIN_THEORETICAL,
    MACHINES,
    with_friction,
)
from pter_gym.params._spread import MachineSpread

__all__ = [
    "ACTUATORS",
    "ARRANGEMENTS",
    "BASELINE",
    "DELRIN_EXPERIMENTAL",
    "DELRIN_THEORETICAL",
    "MACHINES",
    "PAPER_CLUTCHES",
    "SLOTS",
    "Arm",
    "Band",
    "Clutch",
    "Connection",
    "Hand",
    "Lag",
    "Machine",
    "MachineSpread",
    "TorqueCurve",
    "find_machine",
    "find_machines",
    "load_machine",
    "save_machine",
    "with_friction",
]
