"""Hands as they were measured: arms at the hand, and tremors, each with its source and with how it was taken from it.

What was read in a source, its abstract or its tables is ``read``. What follows by a formula from numbers that were read
or are commonly cited is ``derived``. All else is an ``order of magnitude``: no more than that should be made of it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from pter_gym.params import Hand, require

Matrix = tuple[tuple[float, float], tuple[float, float]]
"""A symmetric matrix in the plane."""

Grade = Literal["read", "derived", "order of magnitude"]

GRAVITY = 9.80665
"""m/s²: sources give accelerations in it."""


@dataclass(frozen=True, kw_only=True)
class MeasuredArm:
    """Mass, damper and spring of a human arm at the hand, in the horizontal plane.

    Attributes
    ----------
    mass, damping, stiffness
        Symmetric positive definite matrices [kg], [N·s/m], [N/m].
    axes
        Whether they are in the axes of the body (x to the right, y ahead) or in their own: then only the smallest and
        the largest value over all directions are known, and they are diagonal.
    posture
        Of the person, or what the person does.
    grade, provenance
        Where the numbers come from.
    source
        Who measured, where it is published, and the DOI where it was seen.
    """

    name: str
    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    axes: Literal["body", "own"]
    posture: str
    grade: Grade
    provenance: str
    source: str

    def __post_init__(self) -> None:
        """Check that the matrices are symmetric and positive definite."""
        for name in ("mass", "damping", "stiffness"):
            given = getattr(self, name)
            require(_is_definite(given), self, name, given, "a symmetric positive definite matrix of 2 × 2 numbers")

    @property
    def hand(self) -> Hand:
        """The same in all directions, as the simulator has it: the mean over all directions, half of each trace."""
        mass, damping, stiffness = (0.5 * (m[0][0] + m[1][1]) for m in (self.mass, self.damping, self.stiffness))
        return Hand(mass=mass, damping=damping, stiffness=stiffness)


@dataclass(frozen=True, kw_only=True)
class MeasuredTremor:
    """A tremor of the free hand.

    Attributes
    ----------
    band
        Its frequencies, from and to [Hz].
    acceleration
        Amplitudes of the hand's acceleration, from and to [m/s²].
    grade, provenance
        Where the numbers come from.
    source
        Who measured, where it is published, and the DOI where it was seen.
    """

    name: str
    band: tuple[float, float]
    acceleration: tuple[float, float]
    grade: Grade
    provenance: str
    source: str

    def __post_init__(self) -> None:
        """Check that both are ranges of positive numbers."""
        for name in ("band", "acceleration"):
            low, high = getattr(self, name)
            require(0.0 < low <= high < math.inf, self, name, (low, high), "two positive numbers in order")

    @property
    def middle(self) -> tuple[float, float]:
        """The geometric middle of frequency [Hz] and acceleration [m/s²]."""
        return math.sqrt(math.prod(self.band)), math.sqrt(math.prod(self.acceleration))


def endpoint(joint: Matrix, posture: tuple[float, float], lengths: tuple[float, float]) -> Matrix:
    """Return what a matrix of the joints is at the hand: J⁻ᵀ·joint·J⁻¹, its symmetric part.

    Parameters
    ----------
    joint
        Of shoulder and elbow angle: inertia [kg·m²], stiffness [N·m/rad] or damping [N·m·s/rad].
    posture
        Where the hand is from the shoulder, to the right and ahead [m]; the elbow of this right arm is at its right.
    lengths
        Of upper arm, and forearm with hand [m].
    """
    shoulder, elbow = _angles(posture, lengths)
    upper, lower = lengths
    lower_x, lower_y = lower * math.cos(shoulder + elbow), lower * math.sin(shoulder + elbow)
    x, y = upper * math.cos(shoulder) + lower_x, upper * math.sin(shoulder) + lower_y
    inverse = np.linalg.inv([[-y, -lower_y], [x, lower_x]])
    found = inverse.T @ np.array(joint) @ inverse
    coupling = 0.5 * float(found[0, 1] + found[1, 0])
    return ((float(found[0, 0]), coupling), (coupling, float(found[1, 1])))


def _angles(posture: tuple[float, float], lengths: tuple[float, float]) -> tuple[float, float]:
    """Return the angles of shoulder and elbow [rad] with which a hand is where it is."""
    (x, y), (upper, lower) = posture, lengths
    elbow = math.acos((x * x + y * y - upper * upper - lower * lower) / (2.0 * upper * lower))
    return math.atan2(y, x) - math.atan2(lower * math.sin(elbow), upper + lower * math.cos(elbow)), elbow


def _inertia(elbow: float) -> Matrix:
    """Return the joints' inertia [kg·m²] of the limb of Selen et al., each segment's centre in its middle."""
    upper, lower = LIMB
    m_upper, m_lower, i_upper, i_lower = 1.93, 1.52, 0.04, 0.06
    across = 0.5 * m_lower * upper * lower * math.cos(elbow)
    own = i_lower + 0.25 * m_lower * lower**2
    both = own + across
    return ((i_upper + 0.25 * m_upper * upper**2 + m_lower * upper**2 + both + across, both), (both, own))


def _diagonal(first: float, second: float) -> Matrix:
    """Return a diagonal matrix."""
    return ((first, 0.0), (0.0, second))


def _rounded(matrix: Matrix, factor: float = 1.0) -> Matrix:
    """Return a multiple of a matrix to three digits, the same on every computer."""
    (a, b), (_, d) = ([float(f"{factor * x:.3g}") for x in row] for row in matrix)
    return ((a, b), (b, d))


def _is_definite(matrix: Matrix) -> bool:
    (a, b), (c, d) = matrix
    return math.isfinite(a + b + d) and b == c and a > 0.0 and a * d > b * b


LIMB = (0.31, 0.34)
"""Lengths of upper arm, and forearm with hand [m], of the limb of Selen et al., Table 1."""

MIDWAY = (0.0, 0.435)
"""Middle of a movement straight ahead, from 0.31 to 0.56 m before the shoulder [m] (PMC6672883, Fig. 2)."""

_SELEN = "Selen, Franklin and Wolpert, J. Neurosci. 29 (2009), 10.1523/JNEUROSCI.2826-09.2009"
_LIMB_MASS = _rounded(endpoint(_inertia(_angles(MIDWAY, LIMB)[1]), MIDWAY, LIMB))
_AT_REST = _rounded(endpoint(((10.8, 2.83), (2.51, 8.67)), MIDWAY, LIMB))
_LAG = 0.05  # s: damping over stiffness in the model of Selen et al.

_ARMS = (
    MeasuredArm(
        name="van-beek-2015",
        mass=_diagonal(0.554, 0.554),
        damping=_diagonal(6.45, 6.45),
        stiffness=_diagonal(135.0, 135.0),
        axes="own",
        posture="elbow bent, forearm in a sling; small random displacements",
        grade="read",
        provenance="legend of Fig. 3: one trial of one person in one direction, taken for all",
        source="van Beek, Bergmann Tiest, Mugge and Kappers, Sci. Rep. 5, 18004 (2015), 10.1038/srep18004",
    ),
    MeasuredArm(
        name="gomi-osu-1998",
        mass=_LIMB_MASS,
        damping=_rounded(_AT_REST, _LAG),
        stiffness=_AT_REST,
        axes="body",
        posture="hand 0.435 m ahead of the shoulder, no load",
        grade="derived",
        provenance="joint stiffness 10.8, 2.83, 2.51, 8.67 N·m/rad as commonly cited, not read in the paper; "
        f"limb and damping, 0.05 s times stiffness, from Table 1 of {_SELEN}",
        source="Gomi and Osu, J. Neurosci. 18, 8965 (1998)",
    ),
    MeasuredArm(
        name="gomi-kawato-1997",
        mass=_LIMB_MASS,
        damping=_rounded(_AT_REST, 2.0 * _LAG),
        stiffness=_rounded(_AT_REST, 2.0),
        axes="body",
        posture="in the middle of a movement to the side",
        grade="order of magnitude",
        provenance="the abstract says considerably stiffer than in the same posture; twice `gomi-osu-1998` is chosen",
        source="Gomi and Kawato, Biol. Cybern. 76, 163 (1997), 10.1007/s004220050329",
    ),
    MeasuredArm(
        name="tsuji-1995",
        mass=_diagonal(0.55, 1.5),
        damping=_diagonal(5.0, 15.0),
        stiffness=_diagonal(100.0, 300.0),
        axes="own",
        posture="seated, posture held with a relaxed grip",
        grade="order of magnitude",
        provenance="not read from the paper's tables: the lower half of what `HumanArm` gives for such studies",
        source="Tsuji, Morasso, Goto and Ito, Biol. Cybern. 72, 475 (1995)",
    ),
    MeasuredArm(
        name="dolan-1993",
        mass=_diagonal(0.55, 2.0),
        damping=_diagonal(5.0, 30.0),
        stiffness=_diagonal(100.0, 600.0),
        axes="own",
        posture="seated, posture held",
        grade="order of magnitude",
        provenance="not read from the paper's tables: what `HumanArm` gives for such studies",
        source="Dolan, Friedman and Nagurka, IEEE Trans. SMC 23, 698 (1993), 10.1109/21.256543",
    ),
    MeasuredArm(
        name="burdet-2001",
        mass=_LIMB_MASS,
        damping=_diagonal(30.0, 12.0),
        stiffness=_diagonal(600.0, 250.0),
        axes="body",
        posture="in a movement straight ahead through a field that pushes off the path, after learning",
        grade="order of magnitude",
        provenance="not read from the paper's figures: stiffest across the movement, above the field's 300 to 500 N/m; "
        f"damping 0.05 s times stiffness; mass of the limb of {_SELEN}",
        source="Burdet, Osu, Franklin, Milner and Kawato, Nature 414, 446 (2001)",
    ),
)

MEASURED_ARMS: Mapping[str, MeasuredArm] = MappingProxyType({each.name: each for each in _ARMS})
"""Measured arms by name."""

_LUFT = "band: Luft et al., Sensors 19, 4301 (2019), 10.3390/s19194301"
_GRADES = (
    "amplitudes of 0.5 to 2 cm, moderate to marked on the scale, taken from end to end, "
    "as accelerations at the geometric middle of the band"
)


def _of_excursion(band: tuple[float, float], ends: tuple[float, float]) -> tuple[float, float]:
    """Return amplitudes of acceleration [m/s²] of motions from end to end [m] at the geometric middle of a band."""
    low, high = (0.5 * end * 4.0 * math.pi**2 * math.prod(band) for end in ends)
    return low, high


_TREMORS = (
    MeasuredTremor(
        name="tremor-physiological",
        band=(8.0, 12.0),
        acceleration=(0.0015 * GRAVITY, 0.035 * GRAVITY),
        grade="read",
        provenance="0.0015 to 0.035 g peak in the posture of 97 healthy people, mostly at 6 to 7 Hz, from the abstract",
        source=f"amplitude: Wade, Gresty and Findley, Arch. Neurol. 39, 358 (1982); {_LUFT}",
    ),
    MeasuredTremor(
        name="tremor-essential",
        band=(4.0, 12.0),
        acceleration=_of_excursion((4.0, 12.0), (0.005, 0.02)),
        grade="derived",
        provenance=_GRADES,
        source=f"amplitude: Fahn, Tolosa and Marín (1988), read in Table 1 of PMC5963668; {_LUFT}",
    ),
    MeasuredTremor(
        name="tremor-parkinsonian",
        band=(3.0, 8.0),
        acceleration=_of_excursion((3.0, 8.0), (0.005, 0.02)),
        grade="derived",
        provenance=f"{_GRADES}; commonly 4 to 6 Hz at rest",
        source=f"amplitude: Fahn, Tolosa and Marín (1988), read in Table 1 of PMC5963668; {_LUFT}",
    ),
)

MEASURED_TREMORS: Mapping[str, MeasuredTremor] = MappingProxyType({each.name: each for each in _TREMORS})
"""Measured tremors by name."""
