"""The hand that holds the tip: kinds of hands, and what the kernels know of them."""

from pter_gym.hands.kinds import (
    EQ5_FREQUENCIES,
    HUMAN_ARMS,
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
from pter_gym.hands.model import SINES, HandModel

__all__ = [
    "EQ5_FREQUENCIES",
    "HUMAN_ARMS",
    "NORMAL",
    "NO_HAND",
    "RELAXED",
    "SINES",
    "TENSE",
    "HandModel",
    "HumanArm",
    "MultiSineHand",
    "Operator",
    "RecordedForces",
    "eq5",
    "read_forces",
]
