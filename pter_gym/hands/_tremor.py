"""Arms with tremor: from the measured acceleration of a free hand to a force on the tip."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.fields import parameter, require, require_number
from pter_gym.hands._hand_files import find_arms
from pter_gym.hands._library import LIBRARY_TREMORS
from pter_gym.hands._model import SINES, HandModel
from pter_gym.hands._operators import EQ5_FREQUENCIES, MAX_INSTANTS, HandSpread, HumanArm, Operator

ERROR = tuple(3.0 if frequency < 3.0 else 0.0 for frequency in EQ5_FREQUENCIES)
"""Amplitudes of a person's own error [N]: only below all tremor."""

_FREQUENCY: dict[str, Any] = {"above": 0.0, "at_most": 25.0}


@dataclass(frozen=True, kw_only=True)
class TremorArm(HumanArm):
    """A human arm with tremor: a force in addition to the intended motion.

    Modelling choice. Sources give the acceleration a of the free hand. The free hand is modelled as
    the arm's mass, damper and spring, driven by a tremor force. With ω = 2π·frequency, its
    amplitude is ::

        force = a·|k − mω² + ibω| / ω²

    The same force acts when the hand holds the tip, whose motion then follows from hand, arm and
    clutches together. It acts along one line, at an angle from the path, and waxes and wanes around
    its mean amplitude::

        F(t) = force·(1 + swell·cos(2π·swell_frequency·t + swell_phase))·sin(ωt + phase)

    The whole arm is assumed to tremble. If only the wrist does, with less mass, the force is too
    large: it is an upper bound. Reflexes, fatigue and the effect of load on a tremor's frequency
    are left out.

    Forces are stored at the control instants and linear in between, which attenuates a sine by
    sinc²(frequency·period); this is compensated. After ``lasts`` there is no tremor.
    """

    amplitudes: tuple[float, ...] = parameter(
        "N", "chosen: the person's error, below all tremor", count=SINES, default=ERROR
    )
    frequency: float = parameter("Hz", "see LIBRARY_TREMORS", **_FREQUENCY)
    acceleration: float = parameter(
        "m/s²", "amplitude of the free hand: see LIBRARY_TREMORS", at_least=0.0
    )
    direction: float = parameter(
        "rad", "chosen: from the path, positive to the left", default=0.5 * math.pi
    )
    phase: float = parameter("rad", "chosen", default=0.0)
    swell: float = parameter(
        "1",
        "chosen: how much the amplitude waxes and wanes",
        at_least=0.0,
        at_most=1.0,
        default=0.3,
    )
    swell_frequency: float = parameter("Hz", "chosen: how often it does", default=0.5)
    swell_phase: float = parameter("rad", "chosen", default=0.0)
    lasts: float = parameter(
        "s", "chosen: longer than every scored episode", above=0.0, at_most=3600.0, default=30.0
    )

    def __post_init__(self) -> None:
        """Check that the amplitude does not swell faster than the tremor."""
        super().__post_init__()
        require_number(self, "swell_frequency", at_least=0.0, at_most=self.frequency)

    @property
    def force(self) -> float:
        """Mean amplitude of the force [N] that gives the free hand its acceleration."""
        squared = (2.0 * math.pi * self.frequency) ** 2
        arm = self.impedance
        return self.acceleration * math.hypot(
            arm.stiffness / squared - arm.mass, arm.damping / math.sqrt(squared)
        )

    def tremor(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force of the tremor along its line at times, shape (T,) [N]."""
        swell = 1.0 + self.swell * np.cos(
            2.0 * np.pi * self.swell_frequency * times + self.swell_phase
        )
        return self.force * swell * np.sin(2.0 * np.pi * self.frequency * times + self.phase)

    def model(self, pace: float, substep: float, recording: tuple[int, int]) -> HandModel:
        """Return its constants for the kernels; see ``Operator``."""
        first, count = recording
        return (
            super().model(pace, substep, recording)._replace(record_first=first, record_count=count)
        )

    def sampled(self, period: float) -> NDArray[np.float64]:
        """Return the tremor's forces along and across at the control instants, (T, 2) [N].

        Raises
        ------
        ParameterError
            If there are more than ``MAX_INSTANTS``, or fewer than four in a period of the tremor.
        """
        longest = MAX_INSTANTS * period
        require(self.lasts <= longest, self, "lasts", f"in seconds, up to {longest:g} s")
        fastest = 0.25 / period
        require(
            self.frequency <= fastest, self, "frequency", f"≤ {fastest:g} Hz at this control period"
        )
        kept = float(np.sinc(self.frequency * period)) ** 2
        force = self.tremor(np.arange(math.ceil(self.lasts / period) + 1.0) * period) / kept
        force[-1] = 0.0
        return np.outer(force, (math.cos(self.direction), math.sin(self.direction)))


def _frequency(name: str) -> Any:
    """Declare the frequency of a library tremor."""
    middle, _ = LIBRARY_TREMORS[name].middle
    return parameter(
        "Hz", f"derived: geometric middle of the band of {name}", **_FREQUENCY, default=middle
    )


def _acceleration(name: str) -> Any:
    """Declare the acceleration of a library tremor."""
    _, middle = LIBRARY_TREMORS[name].middle
    return parameter(
        "m/s²", f"derived: geometric middle of the range of {name}", at_least=0.0, default=middle
    )


@dataclass(frozen=True, kw_only=True)
class PhysiologicalTremor(TremorArm):
    """An arm with the tremor that everyone has: ``tremor-physiological`` of ``LIBRARY_TREMORS``."""

    frequency: float = _frequency("tremor-physiological")
    acceleration: float = _acceleration("tremor-physiological")


@dataclass(frozen=True, kw_only=True)
class EssentialTremor(TremorArm):
    """An arm with essential tremor: ``tremor-essential`` of ``LIBRARY_TREMORS``."""

    frequency: float = _frequency("tremor-essential")
    acceleration: float = _acceleration("tremor-essential")


@dataclass(frozen=True, kw_only=True)
class ParkinsonianTremor(TremorArm):
    """An arm with Parkinson's tremor: ``tremor-parkinsonian`` of ``LIBRARY_TREMORS``."""

    frequency: float = _frequency("tremor-parkinsonian")
    acceleration: float = _acceleration("tremor-parkinsonian")


KINDS: Mapping[str, type[TremorArm]] = MappingProxyType(
    {
        "tremor-physiological": PhysiologicalTremor,
        "tremor-essential": EssentialTremor,
        "tremor-parkinsonian": ParkinsonianTremor,
    }
)
"""The hands that tremble, by the names of ``LIBRARY_TREMORS``."""


def find_hand(hand: Operator | str) -> Operator:
    """Return a hand as it is, or by its file or name in ``LIBRARY_ARMS`` or ``LIBRARY_TREMORS``.

    A library arm becomes a human arm with its mass, damper and spring; a tremor becomes a human arm
    that trembles with the middle of the tremor's ranges. ``pter identify --hand`` writes files, of
    which it is the estimate.

    Raises
    ------
    ParameterError
        If there is no such hand; the message suggests the nearest names.
    DataError
        If a file is malformed.
    """
    found = find_hands(hand)
    return found.hand if isinstance(found, HandSpread) else found


def find_hands(hand: Operator | HandSpread | str) -> Operator | HandSpread:
    """Return the distribution of hands that a file describes, or its only hand.

    Arguments and errors are those of ``find_hand``.
    """
    if isinstance(hand, Operator | HandSpread):
        return hand
    name = str(hand)
    return KINDS[name]() if name in KINDS else find_arms(name)
