"""What laws read and remember: the array of gains, and a world's memory.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation,
``obs·scales`` is in physical units, ``gains`` belongs to the law and ``memory`` to one world. What
the memory holds is a record: ``Memory`` for the built-in laws, any other for a law that needs one
(``Policy`` takes it).

Gains of a guiding law are, in this order: ``Nominal``; the voltages, then the torques of the table;
the paces of the rows; the rows, each a record of the law's gains (``gain_record``). Between two
paces the gains are interpolated; beyond them the nearest row applies. If the nominal machine has
clutches other than the paper's, its ``Arrangement`` comes last.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated, Any, NamedTuple, Protocol, TypeVar, overload

from numpy.typing import ArrayLike

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry, flat, joined, lerp, read, rows, width
from pter_gym._physics.arm import Linkage
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.model import optional_arrangement
from pter_gym._physics.scalars import clamp
from pter_gym.params import Machine

R = TypeVar("R")
"""A record of gains."""


class Entries(Protocol):
    """An array (entries,) in compiled code, which reads it by the rows of a record."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __len__(self) -> int: ...

    @overload
    def __getitem__(self, at: slice) -> "Entries": ...

    @overload
    def __getitem__(self, at: float) -> float: ...

    def __setitem__(self, at: float, value: float) -> None: ...


class Memory(NamedTuple):
    """What the built-in laws remember of one world."""

    kept: Annotated[float, Entry("1", "the clutch engaged last, or a counter")]
    brake: Annotated[float, Entry("N", "force along the path that the pace's integral has come to")]
    steps: Annotated[float, Entry("1", "control steps of the episode that went before")]
    episode: Annotated[float, Entry("1", "number of the episode")]


MEMORY = rows(Memory)


class Nominal(NamedTuple):
    """Sizes of the torque table and of the rows of gains, and the nominal machine."""

    knots: Annotated[float, Entry("1", "knots of the torque table")]
    paces: Annotated[float, Entry("1", "paces that have a row of gains")]
    arm: Linkage
    torque_limit: Annotated[float, Entry("N·m", "torque at the largest voltage")]
    voltage_max: Annotated[float, Entry("V", "largest voltage")]
    scale: Annotated[
        PerClutch, Entry("1", "torque over that of the table, 0 for a clutch that is not there")
    ]


RELEASED = -1e30
"""Voltage [V] of a clutch that a law releases: 0 V, whatever is added to it."""


class Gains(NamedTuple):
    """Gains that the parts of guiding laws read, 0 for a law without them.

    ``Guided`` and its subclasses declare units and meanings. ``release`` is the inverse of what
    ``Steering`` declares, so interpolating halfway between a distance and 0, never, doubles the
    distance.
    """

    stiffness: float
    damping_normal: float
    damping_tangential: float
    pace_fraction: float
    pace_integral: float
    grip: float
    feedback: float
    hold_when_stuck: float
    tip_space: float
    slip_threshold: float
    release: float


NOMINAL = rows(Nominal)
"""Places of what a law knows of the machine, in the array of gains."""

ARRANGEMENT = rows(Arrangement, -width(Arrangement))
"""Places of the ``Arrangement``, from the end of the array of gains."""

TABLE = width(Nominal)
"""Where the torque table begins."""


@cache
def gain_record(names: tuple[str, ...]) -> Any:
    """Return the record of a law's gains: ``Gains``, then those of these names that it lacks."""
    own = [(name, float) for name in names if name not in Gains._fields]
    return joined("Gains", Gains, NamedTuple("Own", own)) if own else Gains


def gain_parts(
    machine: Machine, table_volts: Sequence[float], rows_by_pace: Sequence[tuple[float, Any]]
) -> dict[str, ArrayLike]:
    """Return the gains of a guiding law, as ``Policy.from_law`` takes them.

    Parameters
    ----------
    machine
        The nominal machine.
    table_volts
        Knots of the torque table [V], from 0 to the machine's largest voltage; the torques are
        those of its curve.
    rows_by_pace
        Commanded pace [m/s] and record of gains, in order of rising pace.
    """
    arm, clutch = machine.arm, machine.clutch
    torques = [clutch.dynamic.torque(volts) for volts in table_volts]
    without_hand = 0.0, 0.0, 0.5
    linkage = Linkage(
        arm.length_a, arm.length_b, arm.inertia_a, arm.inertia_b, arm.coupling, *without_hand
    )
    scale = PerClutch(*machine.slot_scale)
    sizes = len(table_volts), len(rows_by_pace)
    return {
        "nominal": flat(Nominal(*sizes, linkage, torques[-1], clutch.voltage_max, scale)),
        "table_volts": table_volts,
        "table_torques": torques,
        "gain_paces": [pace for pace, _ in rows_by_pace],
        "gain_rows": flat(tuple(gains for _, gains in rows_by_pace)),
        "arrangement": flat(optional_arrangement(machine) or ()),
    }


def gains_reader(record: type[R]) -> Callable[[Entries, float], R]:
    """Return a compiled function that reads a record of gains at a commanded pace [m/s]."""
    row: Any = rows(record)
    size = width(record)

    @inlined
    def read_gains(gains: Entries, pace: float) -> Any:
        """Return the gains at a commanded pace [m/s]."""
        paces = TABLE + 2 * int(gains[NOMINAL.knots])
        count = int(gains[NOMINAL.paces])
        low = 0
        part = 0.0
        for k in range(count - 1):
            if pace > gains[paces + k]:
                low = k
                part = clamp(
                    (pace - gains[paces + k]) / (gains[paces + k + 1] - gains[paces + k]), 0.0, 1.0
                )
        here = paces + count + low * size
        there = here + (size if count > 1 else 0)
        return lerp(read(gains, row, here), read(gains, row, there), part)

    return read_gains


@inlined
def table_voltage(gains: Entries, torque: float) -> float:
    """Return the voltage [V] at which the table reaches a torque [N·m], at most its last knot."""
    count = int(gains[NOMINAL.knots])
    last = TABLE + count - 1
    volts = gains[last]
    for k in range(last - 1, TABLE - 1, -1):
        low = gains[k + count]
        high = gains[k + 1 + count]
        if torque < high:
            volts = gains[k] + (gains[k + 1] - gains[k]) * (torque - low) / (high - low)
    return volts


@inlined
def clutch_voltage(
    gains: Entries, g: Any, scale: float, wanted: float, slip: float, generated: float
) -> float:
    """Return the voltage [V] for a desired clutch torque, by the table and the loop of Fig. 6.

    Torques are magnitudes, since a voltage cannot choose a sign. A clutch with scale 0 is missing
    and gets 0 V. ``hold_when_stuck`` disables the loop while the clutch is stuck and carries less
    than desired, where a higher voltage has no effect.
    """
    error = abs(wanted) - abs(generated)
    idle = (g.hold_when_stuck >= 0.5) & (abs(slip) <= g.slip_threshold) & (error > 0.0)
    volts = table_voltage(gains, abs(wanted) / scale) + (0.0 if idle else g.feedback * error)
    return clamp(volts, 0.0, gains[NOMINAL.voltage_max]) if scale > 0.0 else 0.0
