"""Parameters of the machine: frozen dataclasses in SI.

Each field names its unit and the source of its value: ``published`` in the paper, ``derived`` from
published values, ``fitted`` to the paper's results, or ``chosen`` by us. A fitted value is not a
fact about PTER.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple, cast

from pter_gym._internal.fields import Checked, parameter, require, require_kind, require_number
from pter_gym.params._connection import BRAKE_A, BRAKE_B, PAPER_CLUTCHES, SLOTS, Connection

Lag = Literal["normal_force", "voltage"]
Band = Literal["vanishing", "printed"]

_CONSTANT = "chosen: T_k is the same at all speeds"
_NO_HAND = "published: the paper's hand is a force alone"
_ISOTROPIC = "chosen: the same in all directions"
_LENGTH = "fitted: PTER's links were of the order of half a metre"
_INERTIA = "fitted: a link with clutch rotors and gears"
_FRICTION = "chosen: Eqs. 3 and 4 have no friction but that of the clutches"


@dataclass(frozen=True, kw_only=True)
class Arm(Checked):
    """The five-bar arm as a two-axis mechanism (paper Eqs. 3 and 4).

    Angles are absolute; M12 = coupling·cos(θA − θB). We found no source for link lengths and
    inertias. Each axis may have dry and viscous friction against the base, which the paper's
    equations omit.
    """

    length_a: float = parameter("m", _LENGTH, above=0.0, default=0.5645)
    length_b: float = parameter("m", _LENGTH, above=0.0, default=0.4454)
    inertia_a: float = parameter("kg·m²", _INERTIA, above=0.0, default=0.4404)
    inertia_b: float = parameter("kg·m²", _INERTIA, above=0.0, default=1.015)
    coupling: float = parameter("kg·m²", "fitted: between the axes", default=-0.05763)
    dry_a: float = parameter("N·m", _FRICTION, at_least=0.0, default=0.0)
    dry_b: float = parameter("N·m", _FRICTION, at_least=0.0, default=0.0)
    viscous_a: float = parameter("N·m·s", _FRICTION, at_least=0.0, default=0.0)
    viscous_b: float = parameter("N·m·s", _FRICTION, at_least=0.0, default=0.0)

    def __post_init__(self) -> None:
        """Check that the mass matrix is positive definite in every pose."""
        super().__post_init__()
        limit = math.sqrt(self.inertia_a * self.inertia_b)
        require_number(self, "coupling", above=-limit, below=limit)


@dataclass(frozen=True, kw_only=True)
class TorqueCurve(Checked):
    """Steady torque of a clutch over voltage (paper section IV-B.1, Fig. 5).

    ``T(v) = off_state + slope·v + curvature·max(v − knee, 0)²`` is C1: a linear and a quadratic
    segment. The paper assumes no torque without voltage; the fluid or powder of other brakes leaves
    some.
    """

    slope: float = parameter(
        "N·m/V", "fitted: breakaway is 63.5 in·lbf (published) between 4 and 8 V", above=0.0
    )
    knee: float = parameter("V", "fitted: where the quadratic segment begins", at_least=0.0)
    curvature: float = parameter("N·m/V²", "fitted: quadratic segment")
    off_state: float = parameter(
        "N·m", "published: section III-A takes it as 0", at_least=0.0, default=0.0, later=True
    )

    def torque(self, volts: float) -> float:
        """Return the torque [N·m] at a voltage [V]."""
        beyond = max(volts - self.knee, 0.0)
        return self.slope * volts + self.curvature * beyond * beyond + self.off_state

    def voltage(self, torque: float) -> float:
        """Return the voltage [V] of a torque [N·m], 0 for less than the off-state torque."""
        torque = max(torque - self.off_state, 0.0) if self.off_state else torque
        excess = torque - self.slope * self.knee
        if excess <= 0.0 or self.curvature == 0.0:
            return torque / self.slope
        root = math.sqrt(self.slope * self.slope + 4.0 * self.curvature * excess)
        return self.knee + 2.0 * excess / (self.slope + root)

    def scaled(self, factor: float) -> "TorqueCurve":
        """Return the curve of a clutch whose friction coefficient is ``factor`` times as large."""
        return TorqueCurve(
            slope=self.slope * factor,
            knee=self.knee,
            curvature=self.curvature * factor,
            off_state=self.off_state * factor,
        )


class ClutchTorques(NamedTuple):
    """Torques of a clutch [N·m], before it slips and while it does."""

    breakaway: float
    dynamic: float


@dataclass(frozen=True, kw_only=True)
class Clutch(Checked):
    """One electromagnetic friction clutch; PTER has four identical ones.

    While it slips at ω it exerts ``T_k + (T_s − T_k)·ω_s²/(ω_s² + ω²) + viscous·|ω|``, a case of
    the paper's g(ω, v) (Eq. 2). With ``stribeck`` ω_s = 0 and without ``viscous``, as for PTER,
    that is T_k at any speed. A falling torque has ``fall_ratio`` times the time constant of a
    rising one. A clutch that has absorbed the heat H keeps 1/(1 + fade·H) of its torque, and H
    decays with the time constant ``cooling``.

    With ``hysteresis`` h, the torque at a voltage v is that of the curves at v − h while v rises
    and at v + h while it falls; where v turns around, the torque stays for 2·h. At 0 V a clutch
    that was engaged keeps the torque of h. A data sheet's ±5 % of the largest torque is an h of 5 %
    of ``voltage_max`` if torque is linear.

    Within the stick band it holds up to T_s. If T_k exceeds T_s, Eq. 2 as printed lets it creep
    at the edge of the band, δω, under a load between the two (``band`` "printed", without
    ``stribeck``, which has no such edge); as the band vanishes, that load holds it ("vanishing").
    """

    breakaway: TorqueCurve = parameter(
        "N·m", "fitted: T_s/T_k is at least 1.12 for the jump of Fig. 9"
    )
    dynamic: TorqueCurve = parameter("N·m", "see TorqueCurve")
    time_constant: float = parameter("s", "published: section IV-C.3", above=0.0, default=0.105)
    voltage_max: float = parameter(
        "V", "chosen: a common supply for such clutches", above=0.0, default=24.0
    )
    lag: Lag = parameter(
        "1", "published: section II-B, from voltage to normal force", default="normal_force"
    )
    stribeck: float = parameter(
        "rad/s", _CONSTANT, at_least=0.0, at_most=1e3, default=0.0, later=True
    )
    viscous: float = parameter("N·m·s", _CONSTANT, at_least=0.0, default=0.0, later=True)
    fall_ratio: float = parameter(
        "1", "published: one time constant (section IV-C.3)", above=0.0, default=1.0, later=True
    )
    fade: float = parameter("1/J", "chosen: no fade", at_least=0.0, default=0.0, later=True)
    cooling: float = parameter(
        "s", "chosen: of no effect without fade", above=0.0, default=60.0, later=True
    )
    band: Band = parameter(
        "1", "chosen: of no effect unless T_k exceeds T_s", default="vanishing", later=True
    )
    hysteresis: float = parameter("V", "chosen: none", at_least=0.0, default=0.0, later=True)

    def __post_init__(self) -> None:
        """Check that both curves are finite, monotone and invertible up to the largest voltage."""
        super().__post_init__()
        require_number(self, "hysteresis", at_least=0.0, below=0.5 * self.voltage_max)
        for name in ("breakaway", "dynamic"):
            curve: TorqueCurve = getattr(self, name)
            end = curve.slope + 2.0 * curve.curvature * max(self.voltage_max - curve.knee, 0.0)
            require(
                end > 0.0,
                self,
                name,
                f"monotone up to voltage_max = {self.voltage_max:g} V",
                got=curve,
            )
        falls = self.band == "printed" and self.stribeck > 0.0
        require(
            not falls, self, "stribeck", "0 with band='printed', whose torque is T_k from δω on"
        )

    def torques(self, volts: float) -> ClutchTorques:
        """Return the steady torques [N·m] at a voltage [V] without hysteresis."""
        return ClutchTorques(self.breakaway.torque(volts), self.dynamic.torque(volts))

    @property
    def least(self) -> ClutchTorques:
        """The least steady torques [N·m]: what is left at 0 V of a clutch that was engaged."""
        return self.torques(self.hysteresis)

    @property
    def largest(self) -> ClutchTorques:
        """The largest steady torques [N·m]."""
        return self.torques(self.voltage_max - self.hysteresis)


@dataclass(frozen=True, kw_only=True)
class Hand(Checked):
    """Mass, damper and spring that the hand adds at the tip, in addition to its force.

    In the paper's tests all three are zero.

    The mass is added to the arm's exactly; the damping is integrated implicitly, the spring
    explicitly. Damping and stiffness may depend on the direction: with an anisotropy (e, f), the
    matrix in the world frame is the number times [[1 + e, f], [f, 1 − e]], and √(e² + f²) ≤ 1. The
    mass is isotropic, since only then does the mass matrix depend on θA − θB alone, on which the
    limits of the integrator and its speed rely.
    """

    mass: float = parameter("kg", _NO_HAND, at_least=0.0, default=0.0)
    damping: float = parameter("N·s/m", _NO_HAND, at_least=0.0, default=0.0)
    stiffness: float = parameter("N/m", _NO_HAND, at_least=0.0, default=0.0)
    damping_anisotropy: tuple[float, ...] = parameter(
        "1", _ISOTROPIC, count=2, default=(0.0, 0.0), later=True
    )
    stiffness_anisotropy: tuple[float, ...] = parameter(
        "1", _ISOTROPIC, count=2, default=(0.0, 0.0), later=True
    )

    def __post_init__(self) -> None:
        """Check that neither matrix has a negative eigenvalue."""
        super().__post_init__()
        for name in ("damping_anisotropy", "stiffness_anisotropy"):
            value = getattr(self, name)
            require(math.hypot(*value) <= 1.0, self, name, "(e, f) with √(e² + f²) ≤ 1")


@dataclass(frozen=True, kw_only=True)
class Machine(Checked):
    """A PTER: arm, clutches, friction model, and the hand that holds the tip.

    A machine with fewer than the paper's four clutches has empty slots, whose voltages have no
    effect. A delay, rounded to control steps, replaces that of a task's sensors.
    """

    arm: Arm = parameter("1", "see Arm", default=Arm())
    clutch: Clutch = parameter("1", "see Clutch")
    hand: Hand = parameter("1", "see Hand", default=Hand())
    clutch_scale: tuple[float, ...] = parameter(
        "1",
        "chosen: each clutch's torques over those of its curves; 0 for a clutch that is not there",
        count=SLOTS,
        at_least=0.0,
        default=(1.0,) * SLOTS,
    )
    clutches: tuple[Connection, ...] = parameter(
        "1",
        "published: Eqs. 3 and 4; other arrangements were never built",
        default=PAPER_CLUTCHES,
        later=True,
    )
    slip_threshold: float = parameter(
        "rad/s", "chosen: δω of Karnopp's model (Eq. 2)", above=0.0, default=1e-3
    )
    substep: float = parameter(
        "s",
        "chosen: longest step of the integrator; a control period has equal ones",
        above=0.0,
        at_most=0.01,
        default=2.5e-3,
    )
    delay: float = parameter(
        "s",
        "chosen: 0, none; from a voltage to the observation of the motion that it makes",
        at_least=0.0,
        default=0.0,
        later=True,
    )

    def __post_init__(self) -> None:
        """Check the numbers of the friction model and that the hand's explicit spring is stable."""
        super().__post_init__()
        self._check_clutches()
        mass = self.hand.mass + tip_mass(self.arm)
        most = self.hand.stiffness * (1.0 + math.hypot(*self.hand.stiffness_anisotropy))
        require(
            most * self.substep**2 <= 0.25 * mass,
            self,
            "hand.stiffness",
            f"≤ {0.25 * mass / self.substep**2:g} N/m, so that substep²·stiffness is at most "
            "a quarter of the tip's mass",
        )

    def _check_clutches(self) -> None:
        """Check names, that slots hold motion in every direction, and where dry friction acts."""
        require_kind(self, "clutches", tuple)
        clutches = self.clutches
        fits = (
            0 < len(clutches) <= SLOTS
            and all(
                isinstance(clutch, Connection) for clutch in cast("tuple[object, ...]", clutches)
            )
            and len({clutch.name for clutch in clutches}) == len(clutches)
        )
        require(fits, self, "clutches", f"1 to {SLOTS} Connections with different names")
        rows = self.slot_rows
        accepted = f"of at least two different rows, if there are {SLOTS}"
        require(len({*rows}) > 1, self, "clutches", accepted)
        ratios = sorted({b for a, b in rows if a != 0.0})
        apart = all(high - low >= 0.01 * max(abs(low), abs(high)) for low, high in pairwise(ratios))
        require(apart, self, "clutches", "of rows that are equal or differ by 1 % at least")
        for name, brake in (("dry_a", BRAKE_A), ("dry_b", BRAKE_B)):
            there = getattr(self.arm, name) == 0.0 or brake.row in rows
            accepted = f"0 where {SLOTS} clutches leave no slot to a brake ({brake.name})"
            require(there, self.arm, name, accepted)

    @property
    def slot_rows(self) -> tuple[tuple[float, float], ...]:
        """The rows of W of all slots; an empty slot has a missing brake's, for dry friction."""
        rows = tuple(clutch.row for clutch in self.clutches)
        empty = [brake.row for brake in (BRAKE_A, BRAKE_B) if brake.row not in rows]
        return (*rows, *empty, *[BRAKE_A.row] * SLOTS)[:SLOTS]

    @property
    def slot_scale(self) -> tuple[float, ...]:
        """The ratios of the slots' torques to those of the curves, 0 where there is no clutch."""
        there = len(self.clutches)
        return self.clutch_scale[:there] + (0.0,) * (SLOTS - there)

    @property
    def has_paper_clutches(self) -> bool:
        """Whether W is the paper's."""
        return [clutch.row for clutch in self.clutches] == [c.row for c in PAPER_CLUTCHES]


def tip_mass(arm: Arm) -> float:
    """Return the smallest effective mass of the tip over all poses and directions [kg].

    It is at least λ_min(M)/λ_max(JᵀJ), taken at the pose where cos(θA − θB) = ±1 makes both
    extreme.
    """
    half_sum = 0.5 * (arm.inertia_a + arm.inertia_b)
    half_difference = 0.5 * (arm.inertia_a - arm.inertia_b)
    smallest = half_sum - math.hypot(half_difference, arm.coupling)
    return smallest / (arm.length_a**2 + arm.length_b**2)
