from ._by_name import CONTROLLERS as CONTROLLERS
from ._guided import (
    Guided as Guided,
    Impedance as Impedance,
    PaceSchedule as PaceSchedule,
    SingleDof as SingleDof,
    TorqueFeedback as TorqueFeedback,
    VelocityRatio as VelocityRatio,
)
from ._policy import (
    AnyPolicy as AnyPolicy,
    Controller as Controller,
    Policy as Policy,
    bind as bind,
)
from ._scaled import Powers as Powers, Scaled as Scaled
from ._simple import Free as Free, Locked as Locked, Random as Random
from ._writing import (
    MEMORY as MEMORY,
    Memory as Memory,
    PerClutch as PerClutch,
    compiled as compiled,
    rows as rows,
)
