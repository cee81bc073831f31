"""One world as one record: its entries are the rows of a kernel's array."""

from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.records import Entry, rows, width
from pter_gym._physics.arm import Motion, PerLink, Vector
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch, Torques
from pter_gym._physics.model import Model
from pter_gym._physics.step import Energy, Impact
from pter_gym.hands._model import HandModel, Sines
from pter_gym.paths._projection import Foot
from pter_gym.tasks.path_following._observation import Observation
from pter_gym.tasks.path_following._rules import PathVector, TaskModel, Terms


class Target(NamedTuple):
    """The point that a hand means to be at, and its velocity."""

    position: Annotated[Vector, Entry("m", "the point where the hand means to be")]
    velocity: Annotated[Vector, Entry("m/s", "the velocity of that point")]


class Drive(NamedTuple):
    """Recorded forces, and their change in a substep."""

    force: Annotated[PathVector, Entry("N", "recorded force")]
    change: Annotated[PathVector, Entry("N", "change per substep of the recorded force")]


class Reading(NamedTuple):
    """What the sensors read at a control instant."""

    theta: Annotated[PerLink, Entry("rad", "angle{}")]
    omega: Annotated[PerLink, Entry("rad/s", "angular velocity{}")]
    torque: Annotated[PerClutch, Entry("N·m", "generated torque{}")]
    force: Annotated[PathVector, Entry("N", "the hand's force{}")]


class Readings(NamedTuple):
    """What the sensors read now, one and two control steps ago."""

    now: Annotated[Reading, Entry("", ", as read now")]
    one_ago: Annotated[Reading, Entry("", ", as read one control step ago")]
    two_ago: Annotated[Reading, Entry("", ", as read two control steps ago")]


class Flags(NamedTuple):
    """How an episode ends; the rows of the flags (FLAGS, N)."""

    terminated: Annotated[
        float, Entry("1", "1 at the end of the path and on leaving the workspace")
    ]
    truncated: Annotated[
        float,
        Entry("1", "1 at the time limit, and where the task ends an episode that has strayed"),
    ]
    success: Annotated[float, Entry("1", "1 at the end of the path")]


class World(NamedTuple):
    """All that a kernel knows of one world."""

    # what every world stores
    motion: Motion
    torques: Torques
    lagged_volts: Annotated[PerClutch, Entry("V", "voltage behind the lag")]
    command: Annotated[PerClutch, Entry("V", "last command")]
    torque: Annotated[PerClutch, Entry("N·m", "last generated torque")]
    sines: Annotated[Sines, Entry("1", "the present phase")]
    step: Annotated[float, Entry("1", "control steps since the reset")]
    alive: Annotated[float, Entry("1", "1 while the episode goes on")]
    foot: Foot
    reached: Annotated[float, Entry("m", "largest arc length so far")]
    pace_ratio: Annotated[
        float, Entry("1", "recent mean of the pace along the path, over the commanded pace")
    ]
    context_at: Annotated[float, Entry("1", "where its context begins in the constants")]
    draws_from: Annotated[float, Entry("1", "where the contexts that it draws from begin")]
    draws: Annotated[float, Entry("1", "number of contexts that it draws from")]
    # what is stored too where hands plan, sensors are not ideal or clutches fade
    drive: Drive
    target: Target
    intent: Annotated[float, Entry("m", "arc length of the intended point")]
    readings: Readings
    heat: Annotated[PerClutch, Entry("J", "heat")]
    # constants, read from where all worlds share them
    machine: Model
    hand: HandModel
    task: TaskModel
    # what a control step works with
    last_command: Annotated[PerClutch, Entry("V", "command before the last")]
    start_velocity: Annotated[Vector, Entry("m/s", "the tip's velocity at the start of the step")]
    energy: Energy
    strength: Annotated[
        PerClutch, Entry("1", "torque, relative to that at the start of the episode")
    ]
    steady: Torques
    impact: Impact
    omega: Annotated[PerLink, Entry("rad/s", "angular velocity after friction")]
    capacity: Annotated[PerClutch, Entry("N·m", "torque limit in this substep")]
    span: Annotated[float, Entry("s", "time that the last part of a kick stands for")]
    switches: Annotated[float, Entry("1", "1 if a clutch changes between sticking and slipping")]
    force: Annotated[Vector, Entry("N", "the hand's force on the tip")]
    travel: Annotated[float, Entry("m", "change of the arc length")]
    advance: Annotated[float, Entry("m", "how far beyond the largest arc length before the step")]
    began: Annotated[float, Entry("1", "1 if the world was alive before the step")]
    terms: Annotated[Terms, Entry("1", "reward term", name="reward")]
    reward: Annotated[float, Entry("1", "sum of the reward terms")]
    end: Flags
    seen: Observation
    arrangement: Arrangement  # with other clutches than the paper's


ROW = rows(World)
"""Rows of a world in the kernel's array (rows, worlds)."""

ROWS = width(World)
"""Rows of the kernel's array."""

BASIC_ROWS = int(ROW.drive.force.along)
"""Rows that every world stores: those before ``drive``."""

STORED_ROWS = int(ROW.machine.arm.length_a)
"""Rows of a world that change: those before its constants.

Not all worlds need those from ``BASIC_ROWS`` on.
"""

CONSTANT_ROWS = int(ROW.last_command.x1) - STORED_ROWS
"""Rows of a world's constants."""

COMMAND_ROWS = int(ROW.strength.x1 - ROW.last_command.x1)
"""Rows behind the constants that a world's command sets."""

FLAG = rows(Flags)
FLAGS = width(Flags)

LANES = 32
"""Largest number of worlds in a block."""

REFUSE, SKIP, NEXT_STEP, SAME_STEP = range(4)
"""What to do with a world that has ended: refuse to step, leave it out, reset it at the next step
or at once.

With SAME_STEP no world stays ended: a world that is not alive was never reset, and is refused.
"""


class Config(NamedTuple):
    """What all worlds of a batch share; the scales of the observation and a law's gains follow in the same array."""

    low: Annotated[float, Entry("action", "smallest action")]
    high: Annotated[float, Entry("action", "largest action")]
    slack: Annotated[float, Entry("action", "how far beyond these an action is clipped")]
    substep: Annotated[float, Entry("s", "step of the integrator")]
    substeps: Annotated[float, Entry("1", "substeps in a control step")]
    limit: Annotated[float, Entry("1", "control steps after which an episode is truncated")]
    frame_skip: Annotated[float, Entry("1", "control steps for which a given action is held")]
    has_law: Annotated[float, Entry("1", "1 for voltages from a law, 0 for given ones")]
    entries: Annotated[float, Entry("1", "entries of an observation before those of the context")]
    inverse_scale: Annotated[Observation, Entry("", "inverse scale of an entry")]


CONFIG = rows(Config)
CONFIG_WIDTH = width(Config)


class Arrays(NamedTuple):
    """The arrays that a kernel works on in addition to the worlds: N worlds, O entries, T steps, K
    columns.

    Attributes
    ----------
    words
        Seed and episode count of each world, uint64 (N, 2).
    obs, final_obs
        Observations (N, O), and with SAME_STEP the last ones of an episode.
    rewards, flags
        (N,) and (FLAGS, N).
    telemetry
        (T, N, K); T may be 0, for no telemetry. With SAME_STEP a second layer holds the last of an
        episode.
    config
        ``Config``, the scales of the observation, a law's gains.
    constants
        Contexts, arcs of paths, recorded forces.
    """

    words: Any
    obs: Any
    final_obs: Any
    rewards: Any
    flags: Any
    telemetry: Any
    config: Any
    constants: Any
