"""The hand that holds the tip: kinds of hands, a library, and constants for the kernels."""

from pter_gym.hands._library import LIBRARY_ARMS, LIBRARY_TREMORS, LibraryArm, LibraryTremor
from pter_gym.hands._model import SINES, HandModel
from pter_gym.hands._operators import (
    EQ5_FREQUENCIES,
    NO_HAND,
    NORMAL,
    RELAXED,
    TENSE,
    HumanArm,
    MultiSineHand,
    Operator,
    RecordedForces,
    eq5,
    read_forces,
)
from pter_gym.hands._tremor import (
    EssentialTremor,
    ParkinsonianTremor,
    PhysiologicalTremor,
    TremorArm,
    find_hand,
)

__all__ = [
    "EQ5_FREQUENCIES",
    "LIBRARY_ARMS",
    "LIBRARY_TREMORS",
    "NORMAL",
    "NO_HAND",
    "RELAXED",
    "SINES",
    "TENSE",
    "EssentialTremor",
    "HandModel",
    "HumanArm",
    "LibraryArm",
    "LibraryTremor",
    "MultiSineHand",
    "Operator",
    "ParkinsonianTremor",
    "PhysiologicalTremor",
    "RecordedForces",
    "TremorArm",
    "eq5",
    "find_hand",
    "read_forces",
]
