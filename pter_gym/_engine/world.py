"""One world as one record: its entries are the rows of a kernel's array."""

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.records import Entry, Records, joined, rows, width
from pter_gym._physics.arm import Motion, PerLink, Vector
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch, Torques
from pter_gym._physics.model import Model
from pter_gym._physics.step import Energy, Impact
from pter_gym.hands._model import HandModel, Sines
from pter_gym.paths._projection import Foot
from pter_gym.tasks.path_following._model import TaskModel
from pter_gym.tasks.path_following._observation import Observation, Reading
from pter_gym.tasks.path_following._position import PathVector
from pter_gym.tasks.path_following._reward import Terms


class Target(NamedTuple):
    """The point that a hand means to be at, and its velocity."""

    position: Annotated[Vector, Entry("m", "the point where the hand means to be")]
    velocity: Annotated[Vector, Entry("m/s", "the velocity of that point")]


class Drive(NamedTuple):
    """Recorded forces, and their change in a substep."""

    force: Annotated[PathVector, Entry("N", "recorded force")]
    change: Annotated[PathVector, Entry("N", "change per substep of the recorded force")]


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


class Addresses(NamedTuple):
    """Where the constants of a world are; only a reset that draws others changes this."""

    context_at: Annotated[float, Entry("1", "where its context begins in the constants")]
    draws_from: Annotated[float, Entry("1", "where the contexts that it draws from begin")]
    draws: Annotated[float, Entry("1", "number of contexts that it draws from")]


class Kept(NamedTuple):
    """What a world keeps from step to step; zero after a reset, unless a reset sets it."""

    motion: Motion
    torques: Torques
    lagged_volts: Annotated[PerClutch, Entry("V", "voltage behind lag and hysteresis")]
    command: Annotated[PerClutch, Entry("V", "last command")]
    torque: Annotated[PerClutch, Entry("N·m", "last generated torque")]
    sines: Annotated[Sines, Entry("1", "the present phase")]
    step: Annotated[float, Entry("1", "control steps since the reset", 1000.0)]
    alive: Annotated[float, Entry("1", "1 while the episode goes on")]
    foot: Foot
    reached: Annotated[float, Entry("m", "largest arc length so far")]
    earned: Annotated[float, Entry("1", "what tracking and precision have paid so far")]
    pace_ratio: Annotated[
        float, Entry("1", "recent mean of the pace along the path, over the commanded pace")
    ]


class Extras(NamedTuple):
    """What only some worlds keep, see ``needs_extras``; in others it is zero and is not stored."""

    drive: Drive
    target: Target
    intent: Annotated[float, Entry("m", "arc length of the intended point")]
    readings: Readings
    heat: Annotated[PerClutch, Entry("J", "heat")]


class Constants(NamedTuple):
    """The beginning of a world's ``Context``, copied from where all worlds share it."""

    machine: Model
    hand: HandModel
    task: TaskModel


class Pay(NamedTuple):
    """What the control steps of an action have paid before the present one."""

    terms: Annotated[Terms, Entry("1", "reward term", name="reward")]
    reward: Annotated[float, Entry("1", "sum of the reward terms")]


class Scratch(NamedTuple):
    """What a control step works with; nothing of it lasts."""

    start_velocity: Annotated[Vector, Entry("m/s", "the tip's velocity at the start of the step")]
    volts: Annotated[PerClutch, Entry("V", "voltage of the clutches")]
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
    before: Pay
    end: Flags
    seen: Observation
    arrangement: Arrangement  # with other clutches than the paper's


if TYPE_CHECKING:

    class World(Addresses, Kept, Extras, Constants, Scratch):  # pyright: ignore[reportGeneralTypeIssues]
        ...

    class WorldState(Kept, Extras): ...  # pyright: ignore[reportGeneralTypeIssues]

else:
    World = joined("World", Addresses, Kept, Extras, Constants, Scratch)
    World.__doc__ = "All that a kernel knows of one world."
    WorldState = joined("WorldState", Kept, Extras)
    WorldState.__doc__ = """State of worlds from step to step: what ``Kept`` and ``Extras`` hold.

    A named tuple of named tuples, such as ``state.motion.theta_a``; each number is float64 (N,) in
    the SI unit that its field is annotated with.
    """

ROW: World = rows(World)
"""Rows of a world in the kernel's array (rows, worlds)."""

ROWS = width(World)
"""Rows of the kernel's array."""


class Span(NamedTuple):
    """Rows of one of the records of which a world is made: its first, and the first of the next."""

    first: int
    end: int


ADDRESSES = Span(0, width(Addresses))
KEPT = Span(ADDRESSES.end, ADDRESSES.end + width(Kept))
EXTRAS = Span(KEPT.end, KEPT.end + width(Extras))
CONSTANTS = Span(EXTRAS.end, EXTRAS.end + width(Constants))

STATE: WorldState = rows(WorldState, KEPT.first)
"""Rows of a world's state in the kernel's array."""

BASIC_ROWS, STORED_ROWS = EXTRAS.first, EXTRAS.end
"""Rows of a world that are stored from step to step: without its extras, and with them."""

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
    """What all worlds of a batch share; the scales of the observation follow in the same array."""

    low: Annotated[float, Entry("action", "smallest action")]
    high: Annotated[float, Entry("action", "largest action")]
    slack: Annotated[float, Entry("action", "how far beyond these an action is clipped")]
    substep: Annotated[float, Entry("s", "step of the integrator")]
    substeps: Annotated[float, Entry("1", "substeps in a control step")]
    max_steps: Annotated[float, Entry("1", "control steps after which an episode is truncated")]
    frame_skip: Annotated[float, Entry("1", "control steps for which a given action is held")]
    entries: Annotated[float, Entry("1", "entries of an observation before those of the context")]
    inverse_scale: Annotated[Observation, Entry("", "inverse scale of an entry")]


CONFIG = rows(Config)
CONFIG_WIDTH = width(Config)


class Arrays(NamedTuple):
    """The arrays that a kernel works on in addition to the worlds: N worlds, O entries, K columns.

    Attributes
    ----------
    words
        Seed and episode count of each world, uint64 (N, 2).
    obs, final_obs
        Observations (N, O), and with SAME_STEP the last ones of an episode.
    rewards, flags
        (N,) and (FLAGS, N).
    telemetry
        (1, N, K), or (0, …) for none. With SAME_STEP a second layer holds the last of an episode.
    config
        ``Config``, and the scales of the observation.
    constants
        Contexts, arcs of paths, recorded forces.
    """

    words: NDArray[np.uint64]
    obs: Records
    final_obs: Records
    rewards: Records
    flags: Records
    telemetry: NDArray[np.float64]
    config: Records
    constants: Records
