from ._library import (
    LIBRARY_ARMS as LIBRARY_ARMS,
    LIBRARY_TREMORS as LIBRARY_TREMORS,
    LibraryArm as LibraryArm,
    LibraryTremor as LibraryTremor,
)
from ._model import SINES as SINES, HandModel as HandModel
from ._operators import (
    NORMAL as NORMAL,
    RELAXED as RELAXED,
    TENSE as TENSE,
    HandSpread as HandSpread,
    HumanArm as HumanArm,
    MultiSineHand as MultiSineHand,
    Operator as Operator,
    RecordedForces as RecordedForces,
    eq5 as eq5,
    read_forces as read_forces,
)
from ._tremor import (
    EssentialTremor as EssentialTremor,
    ParkinsonianTremor as ParkinsonianTremor,
    PhysiologicalTremor as PhysiologicalTremor,
    TremorArm as TremorArm,
    find_hand as find_hand,
    find_hands as find_hands,
)
