"""A task as the kernels see it: its constants."""

from typing import Annotated, NamedTuple

from pter_gym._compiled.records import Entry
from pter_gym._physics.clutch import PerClutch
from pter_gym.tasks.path_following._position import FreeBand
from pter_gym.tasks.path_following._reward import Terms


class PathModel(NamedTuple):
    """Start and number of a path's arcs in the constants, and its length."""

    first: Annotated[float, Entry("1", "where the path's arcs begin in the constants")]
    arcs: Annotated[float, Entry("1", "number of the path's arcs")]
    length: Annotated[float, Entry("m", "length of the path")]


class SensingModel(NamedTuple):
    """Effects between the machine and the observation."""

    angle_resolution: Annotated[float, Entry("rad", "step of the joint encoders")]
    velocity_noise: Annotated[
        float, Entry("rad/s", "standard deviation of the angular velocities' noise")
    ]
    torque_noise: Annotated[float, Entry("N·m", "standard deviation of the torques' noise")]
    force_noise: Annotated[float, Entry("N", "standard deviation of the force's noise")]
    encoder_velocity: Annotated[
        float, Entry("1", "1 if velocities are differences of encoder readings")
    ]
    delay: Annotated[float, Entry("1", "control steps from measurement to observation")]
    is_ideal: Annotated[float, Entry("1", "1 if sensors are exact and without delay")]


class StartModel(NamedTuple):
    """How episodes begin."""

    moving: Annotated[
        float, Entry("1", "share of the episodes that begin anywhere along the path, moving")
    ]
    gripped: Annotated[
        float, Entry("1", "share of the episodes that begin at rest with settled clutches")
    ]
    offset: Annotated[
        float, Entry("m", "half-range of the distance from the path of those that begin moving")
    ]


class FailureModel(NamedTuple):
    """What becomes of the clutches, and when."""

    torque: Annotated[
        PerClutch, Entry("1", "share of the torque that is left", name="failed_torque")
    ]
    volts: Annotated[
        PerClutch, Entry("V", "voltage that it holds, −1 for none", name="failed_volts")
    ]
    after: Annotated[
        PerClutch, Entry("1", "control steps until it fails", 1000.0, name="failed_after")
    ]


class TaskModel(NamedTuple):
    """Constants of one task."""

    path: Annotated[PathModel, Entry()]
    free: FreeBand
    pace: Annotated[float, Entry("m/s", "commanded mean speed along the path")]
    pace_decay: Annotated[
        float, Entry("1", "part of a new speed in the mean that the reward judges")
    ]
    error_max: Annotated[float, Entry("m", "the workspace ends this far from the path")]
    truncation_error: Annotated[float, Entry("m", "an episode is truncated this far from the path")]
    arrival: Annotated[float, Entry("m", "how near to the path its end counts as reached")]
    singularity_margin: Annotated[float, Entry("1", "smallest |sin(θA − θB)| of the workspace")]
    energy_max: Annotated[
        float, Entry("J", "an episode ends as a failure above this kinetic energy")
    ]
    start_offset: Annotated[float, Entry("m", "half-range of the start's normal offset")]
    starts: StartModel
    friction_drift: Annotated[
        float, Entry("1/s", "relative change of all clutch torques in a second")
    ]
    failures: FailureModel
    weight: Annotated[Terms, Entry("", "weight", 100.0)]
    sensing: SensingModel
