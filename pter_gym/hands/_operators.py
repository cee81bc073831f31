"""The hand that holds the tip: prescribed forces, or a human arm with an intent.

All hands push along the path and disturb across it with up to five sines. A human arm also pulls
the tip towards a point that moves along the path; recorded forces add to the rest.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.fields import Checked, parameter, require, require_numbers
from pter_gym._internal.files import FilePath
from pter_gym._internal.tables import read_table
from pter_gym._physics.arm import UnitVector
from pter_gym.errors import ParameterError
from pter_gym.hands._model import NO_FORCE, SINES, HandModel, PerSine, Sines
from pter_gym.params import Hand
from pter_gym.params._spread import Spread

EQ5_FREQUENCIES = tuple(2.0**n / 2.0 for n in range(SINES))
"""Frequencies of Eq. 5 [Hz]: sin(2ⁿπt) for n = 0 … 4."""

MAX_INSTANTS = 1_000_000
"""Most control periods that a recording may take: almost three hours at 100 Hz."""

MAX_INTERVAL = 0.5
"""Longest usual time between rows of a recording in a file [s]."""

MAX_DURATION = 600.0
"""Longest recording in a file [s]."""

_FIVE: dict[str, Any] = {"count": SINES}
_RATES: dict[str, Any] = {"count": SINES, "at_least": 0.0}
_UP_TO_TEN: dict[str, Any] = {"above": 0.0, "at_most": 10.0}

NO_HAND = Hand()
"""What a hand adds to the arm that is a force alone."""


class Operator(Checked, ABC):
    """A kind of hand, a frozen dataclass: its forces, and the impedance that it adds to the arm.

    Attributes
    ----------
    impedance
        Mass, damper and spring that it adds to the arm at the tip.
    frequencies, phases
        Frequencies [Hz] and phases [rad] of its sines. A kind with sines has all of these as
        fields.
    random_phases
        Whether a reset draws the phases. Test episodes and the search for the worst hand then fix
        them beforehand.
    """

    impedance: Hand = NO_HAND
    frequencies: tuple[float, ...] = ()
    phases: tuple[float, ...] = ()
    random_phases: bool = False
    plans: ClassVar[bool] = True
    """Whether it does more than push and disturb, so its worlds have to store what it plans."""

    @abstractmethod
    def model(self, pace: float, substep: float, recording: tuple[int, int]) -> HandModel:
        """Return its constants for the kernels.

        Parameters
        ----------
        pace, substep
            Commanded pace [m/s] and substep [s].
        recording
            Start of its recording in the array of constants, and its number of instants.
        """

    def sampled(self, period: float) -> NDArray[np.float64]:  # noqa: ARG002
        """Return recorded forces along and across the path at the control instants, (T, 2) [N]."""
        return np.empty((0, 2))


@dataclass(frozen=True, kw_only=True)
class MultiSineHand(Operator):
    """A constant force along the path and five sines across it (paper section IV-A, Eq. 5).

    The default is Eq. 5: equal amplitudes Fmax/5, frequencies 2ⁿ/2 Hz, phases 0. Neither force is
    printed in the paper.
    """

    push: float = parameter(
        "N", "fitted: the constant tangential force of section IV-A", default=57.67
    )
    amplitudes: tuple[float, ...] = parameter(
        "N", "fitted: Fmax/5 each (Eq. 5)", **_FIVE, default=(21.82 / SINES,) * SINES
    )
    frequencies: tuple[float, ...] = parameter(
        "Hz", "published: Eq. 5", **_RATES, default=EQ5_FREQUENCIES
    )
    phases: tuple[float, ...] = parameter(
        "rad", "published: Eq. 5", **_FIVE, default=(0.0,) * SINES
    )
    random_phases: bool = parameter(
        "1", "chosen: False is Eq. 5; True draws the phases at each reset", default=False
    )

    plans: ClassVar[bool] = False

    def model(self, pace: float, substep: float, recording: tuple[int, int]) -> HandModel:  # noqa: ARG002
        """Return its constants for the kernels; see ``Operator``."""
        return with_sines(self, substep)._replace(push=self.push)

    def normal_force(self, time: float) -> float:
        """Return the force across the path [N] at a time [s] (Eq. 5)."""
        waves = zip(self.amplitudes, self.frequencies, self.phases, strict=True)
        return sum(a * math.sin(2.0 * math.pi * f * time + phase) for a, f, phase in waves)


def eq5(force_max: float, push: float) -> MultiSineHand:
    """Return the hand of the paper's standard test: Fmax of Eq. 5 and the tangential force [N]."""
    return MultiSineHand(push=push, amplitudes=(force_max / SINES,) * SINES)


RELAXED = Hand(mass=0.6, damping=6.0, stiffness=120.0)
"""A relaxed human arm at the hand. The three lie in the ranges that ``HumanArm`` states."""

NORMAL = Hand(mass=1.2, damping=14.0, stiffness=300.0)
"""A human arm as one holds it in a task of some accuracy."""

TENSE = Hand(mass=2.0, damping=28.0, stiffness=600.0)
"""A human arm with its muscles tensed against disturbances."""


@dataclass(frozen=True, kw_only=True)
class HumanArm(Operator):
    """A human arm: mass, damper and spring between the tip and the hand's moving target.

    The point moves along the path. It starts from rest with minimum jerk, so with the velocity
    3u² − 2u³ over its rise time (Flash and Hogan, J. Neurosci. 5, 1985, with a free end point), to
    ``eagerness`` times the commanded pace: a passive arm can only slow a hand down. It never leads
    the tip by more than ``lead``. Sines across the path are the person's error and tremor.

    Orders of magnitude for human arms at the hand are 0.55 to 2 kg, 5 to 30 N·s/m and 100 to 600
    N/m, taken as isotropic here. These ranges were not read from the studies that measure such
    arms: Mussa-Ivaldi, Hogan and Bizzi (J. Neurosci. 5, 1985), Dolan, Friedman and Nagurka (IEEE
    Trans. SMC 23, 1993), Tsuji, Morasso, Goto and Ito (Biol. Cybern. 72, 1995).
    """

    impedance: Hand = parameter(
        "1", "chosen: within the order of magnitude of human arms", default=NORMAL
    )
    eagerness: float = parameter(
        "1", "chosen: intended over commanded pace", **_UP_TO_TEN, default=1.4
    )
    rise: float = parameter(
        "s", "chosen: time in which the intent gathers speed", **_UP_TO_TEN, default=0.3
    )
    lead: float = parameter(
        "m", "chosen: how far the intent may run ahead of the tip", **_UP_TO_TEN, default=0.12
    )
    amplitudes: tuple[float, ...] = parameter(
        "N", "chosen: error and tremor", **_FIVE, default=(3.0, 3.0, 2.0, 1.0, 1.0)
    )
    frequencies: tuple[float, ...] = parameter(
        "Hz", "chosen: as Eq. 5", **_RATES, default=EQ5_FREQUENCIES
    )
    phases: tuple[float, ...] = parameter("rad", "chosen", **_FIVE, default=(0.0,) * SINES)
    random_phases: bool = parameter(
        "1", "chosen: whether the phases are drawn at each reset", default=False
    )

    def __post_init__(self) -> None:
        """Check that the arm has a spring."""
        super().__post_init__()
        require(self.impedance.stiffness > 0.0, self, "impedance.stiffness", "> 0 N/m")

    def model(self, pace: float, substep: float, recording: tuple[int, int]) -> HandModel:  # noqa: ARG002
        """Return its constants for the kernels; see ``Operator``."""
        return with_sines(self, substep)._replace(
            intent_speed=self.eagerness * pace, intent_rise=self.rise, intent_lead=self.lead
        )


@dataclass(frozen=True, kw_only=True)
class HandSpread(Spread[HumanArm]):
    """Human arms whose numbers are normally distributed about those of one.

    ``pter identify --hand`` writes one into its file: the hands that fit the log. A number below
    the minimum of its field becomes the minimum, and an invalid hand is drawn again.

    Attributes
    ----------
    hand
        The hand in the middle.
    places
        What varies: the places of numbers, such as ``impedance.stiffness``.
    covariance
        Covariance of these numbers, a row for each, in products of their units.

    Raises
    ------
    ParameterError
        If a place is not that of a number, or the covariance is not one of as many numbers.
    """

    hand: HumanArm
    places: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]

    @property
    def middle(self) -> HumanArm:
        """The hand in the middle."""
        return self.hand


@dataclass(frozen=True, kw_only=True)
class RecordedForces(Operator):
    """Forces over time from a recording: along the path, and across it, positive to the left.

    The forces are interpolated at the control instants and linear in between; after the last time
    they stay constant.
    """

    times: tuple[float, ...] = parameter("s", "recorded")
    along: tuple[float, ...] = parameter("N", "recorded")
    across: tuple[float, ...] = parameter("N", "recorded")

    def __post_init__(self) -> None:
        """Check that there are as many forces as times, and that these rise from 0."""
        super().__post_init__()
        if fault := fault_in(self.times, lambda k: f"entry {k}"):
            raise ParameterError(f"RecordedForces.times must be rising from 0, but {fault}")
        for name in ("along", "across"):
            require_numbers(self, name, count=len(self.times))

    def model(self, pace: float, substep: float, recording: tuple[int, int]) -> HandModel:  # noqa: ARG002
        """Return its constants for the kernels; see ``Operator``."""
        first, count = recording
        return NO_FORCE._replace(record_first=first, record_count=count)

    def sampled(self, period: float) -> NDArray[np.float64]:
        """Return the forces along and across at the control instants up to the end, (T, 2) [N].

        Raises
        ------
        ParameterError
            If there are more than ``MAX_INSTANTS``.
        """
        longest, end = MAX_INSTANTS * period, self.times[-1]
        require(end <= longest, self, "times", f"in seconds, up to {longest:g} s", got=end)
        instants = period * np.arange(math.ceil(end / period) + 1)
        return np.column_stack(
            [np.interp(instants, self.times, force) for force in (self.along, self.across)]
        )


def read_forces(file: FilePath) -> RecordedForces:
    """Return the recording in a CSV file: columns ``time`` [s], ``along`` and ``across`` [N].

    Raises
    ------
    ParameterError
        If the file cannot be read, a column is missing, a number is not finite, the times do not
        rise from 0, or rows are more than ``MAX_INTERVAL`` apart or last more than
        ``MAX_DURATION``, as where times are milliseconds.
    """
    units = {"time": "s", "along": "N", "across": "N"}
    columns, lines, _ = read_table(file, tuple(units), unit=units)
    times, along, across = (tuple(columns[name].tolist()) for name in units)
    if fault := fault_in(times, lambda k: f"line {lines[k]}"):
        raise ParameterError(f"{file}, {fault}")
    interval, end = float(np.median(np.diff(times))) if len(times) > 1 else 0.0, max(times)
    if interval > MAX_INTERVAL or end > MAX_DURATION:
        raise ParameterError(
            f"{file}: time must have rows at most {MAX_INTERVAL:g} s apart and end within "
            f"{MAX_DURATION:g} s, got rows {interval:g} s apart that end at {end:g} s: are these "
            "seconds?"
        )
    return RecordedForces(times=times, along=along, across=across)


def fault_in(times: Sequence[float], label: Callable[[int], str]) -> str | None:
    """Describe the first invalid time of a recording, or return None; ``label`` names times."""
    if not times:
        return "there is no time"
    if times[0] != 0.0:
        return f"{label(0)}: time must begin at 0, got {times[0]:.9g}"
    for k in range(1, len(times)):
        if not times[k - 1] < times[k]:
            return f"{label(k)}: time {times[k]:.9g} does not rise from that of {label(k - 1)}"
    return None


def with_sines(hand: MultiSineHand | HumanArm, substep: float) -> HandModel:
    """Return the constants of a hand that only disturbs across the path, for a substep [s]."""
    return NO_FORCE._replace(
        random_phases=float(hand.random_phases),
        amplitude=PerSine(*hand.amplitudes),
        phase=PerSine(*hand.phases),
        half_turn=half_turns(hand.frequencies, substep),
    )


@lru_cache(1024)
def half_turns(frequencies: tuple[float, ...], substep: float) -> Sines:
    """Return how far sines turn in half a substep [s]."""
    angles = (math.pi * f * substep for f in frequencies)
    return Sines(*(UnitVector(math.cos(angle), math.sin(angle)) for angle in angles))
