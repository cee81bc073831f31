from ._by_name import CONTROLLERS as CONTROLLERS
from ._detector import FailureDetector as FailureDetector, FaultTolerant as FaultTolerant
from ._guided import (
    Guided as Guided,
    Impedance as Impedance,
    PaceSchedule as PaceSchedule,
    TorqueFeedback as TorqueFeedback,
)
from ._policy import (
    AnyPolicy as AnyPolicy,
    Controller as Controller,
    Policy as Policy,
    bind as bind,
)
from ._scaled import Powers as Powers, Scaled as Scaled
from ._simple import (
    Free as Free,
    Locked as Locked,
    Playback as Playback,
    Random as Random,
    read_playback as read_playback,
)
from ._steering import SingleDof as SingleDof, VelocityRatio as VelocityRatio
from ._writing import (
    MEMORY as MEMORY,
    Gains as Gains,
    Memory as Memory,
    Nominal as Nominal,
    PerClutch as PerClutch,
    PerLink as PerLink,
    Tip as Tip,
    allocate as allocate,
    clutch_voltage as clutch_voltage,
    compiled as compiled,
    joint_torque as joint_torque,
    pace_integral as pace_integral,
    passive_torques as passive_torques,
    rows as rows,
    speed_along as speed_along,
    table_voltage as table_voltage,
)
