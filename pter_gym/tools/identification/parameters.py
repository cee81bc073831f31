# pyright: standard
"""A machine as coordinates for an optimiser, and the numbers that a user reads."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import MIN_POSITIVE, Machine, TorqueCurve

Array = NDArray[np.float64]


class Coordinate(NamedTuple):
    """One searched number: the reported one that is unknown without it, and a small change of it.

    Then the largest standard error with which it counts as seen at all, its bounds, and why a log
    does not show it.
    """

    quantity: str
    step: float
    max_error: float
    low: float
    high: float
    unseen: str


_STEP = "no voltage was stepped while a clutch slipped, or the rows are too coarse"
_FRICTION, _OFFSET = (
    f"the log hardly shows {what}"
    for what in ("the friction of this axis", "a constant torque on this axis")
)

COORDINATES = (
    Coordinate("inertia_a", 0.01, 0.25, -6.0, 5.0, "the log hardly shows the inertia of link A"),
    Coordinate("inertia_b", 0.01, 0.25, -6.0, 5.0, "the log hardly shows the inertia of link B"),
    Coordinate("coupling", 0.01, 0.25, -0.95, 0.95, "the log hardly shows the axes' coupling"),
    *(
        Coordinate(f"scale_{x}", 0.01, 0.25, -6.0, 6.0, f"the log hardly shows clutch {x} slipping")
        for x in range(1, 5)
    ),
    Coordinate("curvature", 0.1, math.inf, -20.0, 1e3, "torque is straight where clutches slipped"),
    Coordinate("knee", 0.1, 2.0, 0.0, 1e3, "clutches slipped at one voltage above the knee only"),
    Coordinate("breakaway_ratio", 0.01, 0.15, 0.6, 4.0, "the log hardly shows breakaways"),
    Coordinate("time_constant", 0.02, 0.25, math.log(3e-3), math.log(2.0), _STEP),
    Coordinate("delay", 0.5e-3, 5e-3, -0.01, 0.1, _STEP),
    *(Coordinate(name, 0.05, 2.0, 0.0, 100.0, _FRICTION) for name in ("dry_a", "dry_b")),
    *(Coordinate(name, 0.02, 1.0, 0.0, 100.0, _FRICTION) for name in ("viscous_a", "viscous_b")),
    Coordinate("off_state", 0.02, 1.0, 0.0, 100.0, "the log hardly shows torque without voltage"),
    Coordinate("stribeck", 0.02, 0.3, 0.0, 3.0, "the log hardly shows how torque varies with slip"),
    Coordinate("fall_ratio", 0.02, 0.25, math.log(0.1), math.log(10.0), _STEP),
    *(Coordinate(name, 0.05, 2.0, -100.0, 100.0, _OFFSET) for name in ("offset_a", "offset_b")),
    Coordinate("force_delay", 0.5e-3, 5e-3, -0.1, 0.1, "the log hardly shows when forces act"),
)
"""Logarithms of inertias, of slopes of the four torque curves and of the time constant; the
coupling over √(M11·M22); the quadratic segment's share [V] of the torque over the slope at the
highest voltage; its knee [V]; T_s/T_k; the delay [s]; the friction of each axis over its inertia,
dry [rad/s²] and viscous [1/s]; the off-state torque [N·m]; the Stribeck velocity [rad/s]; the
logarithm of the time constant of a falling torque over that of a rising one; a constant torque on
each axis over its inertia [rad/s²]; how late forces are recorded [s]."""

COUNT = len(COORDINATES)
INERTIA_A, INERTIA_B, COUPLING = 0, 1, 2
SLOPES = (3, 4, 5, 6)
EXTRA, KNEE, RATIO, TIME_CONSTANT, DELAY = 7, 8, 9, 10, 11
DRY, VISCOUS = (12, 13), (14, 15)
OFF_STATE, STRIBECK, FALL_RATIO = 16, 17, 18
OFFSET, FORCE_DELAY = (19, 20), 21

CLUTCH_TERMS = (OFF_STATE, STRIBECK, FALL_RATIO)
TERMS = (*CLUTCH_TERMS, *OFFSET, FORCE_DELAY)
"""Coordinates that the paper's machine does not have: searched only if a log asks for them."""

STEPS = np.array([each.step for each in COORDINATES])
MAX_ERRORS = np.array([each.max_error for each in COORDINATES])
LOWEST = np.array([each.low for each in COORDINATES])

CONTROL_PERIOD, USUAL_STRIBECK, ROOM = 0.01, 0.1, 0.5
"""Control step by which delays are judged [s], Stribeck velocity by which lower ones are [rad/s],
and least distance from the knee to the highest voltage [V]."""


@dataclass(frozen=True)
class Shape:
    """How coordinates become a machine that is ``start`` in all else.

    ``top`` is the highest voltage at which a clutch slipped [V]. From ``kept_knee`` on, the
    curvature of the start is kept relative to its slope; None where both are searched. ``live`` are
    the clutches whose slope is identified: the common slope is their mean.
    """

    start: Machine
    top: float
    kept_knee: float | None = None
    live: tuple[int, ...] = (0, 1, 2, 3)

    def machine(self, p: Array) -> Machine:
        """Return the machine at coordinates."""
        before, slopes = self.start.clutch, np.exp(p[list(SLOPES)])
        slope = float(slopes[list(self.live)].mean()) if self.live else before.dynamic.slope
        scale = list(self.start.clutch_scale)
        for x in self.live:
            scale[x] = float(slopes[x] / slope)
        if self.kept_knee is not None:
            knee = self.kept_knee
            curvature = slope * before.dynamic.curvature / before.dynamic.slope
        else:
            knee = float(p[KNEE])
            curvature = slope * float(p[EXTRA]) / max(self.top - knee, 0.5 * ROOM) ** 2
        if curvature < 0.0:  # what falls within the log must not fall below zero slope beyond it
            curvature = max(curvature, -0.49 * slope / max(before.voltage_max - knee, 1e-6))
        dynamic = TorqueCurve(
            slope=slope, knee=knee, curvature=curvature, off_state=float(p[OFF_STATE])
        )
        clutch = replace(
            before,
            dynamic=dynamic,
            breakaway=dynamic.scaled(float(p[RATIO])),
            time_constant=math.exp(p[TIME_CONSTANT]),
            stribeck=float(p[STRIBECK]),
            fall_ratio=math.exp(p[FALL_RATIO]),
        )
        inertia_a, inertia_b = math.exp(p[INERTIA_A]), math.exp(p[INERTIA_B])
        arm = replace(
            self.start.arm,
            inertia_a=inertia_a,
            inertia_b=inertia_b,
            coupling=float(p[COUPLING]) * math.sqrt(inertia_a * inertia_b),
            dry_a=float(p[DRY[0]]) * inertia_a,
            dry_b=float(p[DRY[1]]) * inertia_b,
            viscous_a=float(p[VISCOUS[0]]) * inertia_a,
            viscous_b=float(p[VISCOUS[1]]) * inertia_b,
        )
        delay = max(float(p[DELAY]), 0.0)
        return replace(self.start, arm=arm, clutch=clutch, clutch_scale=tuple(scale), delay=delay)

    def offsets(self, p: Array) -> tuple[float, float]:
        """Return the constant torques on the axes at coordinates [N·m]."""
        return float(p[OFFSET[0]] * np.exp(p[0])), float(p[OFFSET[1]] * np.exp(p[1]))

    def coordinates(self, machine: Machine, delay: float = 0.0) -> Array:
        """Return the coordinates of a machine; a knee beyond the log is moved into it."""
        arm, clutch, curve = machine.arm, machine.clutch, machine.clutch.dynamic
        inside = curve.knee <= self.top - ROOM
        knee = curve.knee if inside else max(0.5 * self.top, 0.0)
        found = [
            *(math.log(arm.inertia_a), math.log(arm.inertia_b)),
            arm.coupling / math.sqrt(arm.inertia_a * arm.inertia_b),
            *(math.log(max(curve.slope * scale, MIN_POSITIVE)) for scale in machine.clutch_scale),
            curve.curvature / curve.slope * (self.top - knee) ** 2 if inside else 0.0,
            *(knee, clutch.breakaway.slope / curve.slope, math.log(clutch.time_constant), delay),
            *(arm.dry_a / arm.inertia_a, arm.dry_b / arm.inertia_b),
            *(arm.viscous_a / arm.inertia_a, arm.viscous_b / arm.inertia_b),
            *(curve.off_state, clutch.stribeck, math.log(clutch.fall_ratio)),
            *(0.0, 0.0, 0.0),
        ]
        return np.array(found).clip(LOWEST, self.highest)

    @property
    def highest(self) -> Array:
        """Upper bounds of the coordinates."""
        bounds = np.array([each.high for each in COORDINATES])
        bounds[KNEE] = max(self.top - ROOM, 1e-3)
        return bounds

    def quantities(self, p: Array) -> "list[Quantity]":
        """Return the reported numbers at coordinates."""
        delays = float(p[DELAY]), float(p[FORCE_DELAY])
        return quantities(self.machine(p), delays[0], self.top, self.offsets(p), delays[1])


class Quantity(NamedTuple):
    """One reported number: its value, the scale of its errors, and its fields in a machine file."""

    name: str
    unit: str
    value: float
    scale: float
    places: tuple[str, ...] = ()


def quantities(
    machine: Machine,
    delay: float,
    top: float,
    offsets: tuple[float, float] = (0.0, 0.0),
    force_delay: float = 0.0,
) -> list[Quantity]:
    """Return the reported numbers of a machine, delays [s] and constant torques on the axes [N·m].

    ``torque_25`` to ``torque_100`` are the mean dynamic torque at shares of ``top``, the highest
    voltage at which a clutch slipped [V]. What may be zero is judged by something else of its unit:
    the coupling by √(M11·M22), delays by at least a control step, the friction by at least
    ``torque_25``, at 1 rad/s.
    """
    arm, clutch, curve = machine.arm, machine.clutch, machine.clutch.dynamic
    low = curve.torque(0.25 * top)
    numbers: list[Quantity] = []

    def add(name: str, unit: str, value: float, *places: str, least: float = 0.0) -> None:
        numbers.append(Quantity(name, unit, value, max(abs(value), least), places))

    both, (offset_a, offset_b) = math.sqrt(arm.inertia_a * arm.inertia_b), offsets
    add("inertia_a", "kg·m²", arm.inertia_a, "arm.inertia_a")
    add("inertia_b", "kg·m²", arm.inertia_b, "arm.inertia_b")
    add("coupling", "kg·m²", arm.coupling, "arm.coupling", least=both)
    for percent in (25, 50, 75, 100):
        add(f"torque_{percent}", "N·m", curve.torque(0.01 * percent * top))
    add("slope", "N·m/V", curve.slope, "clutch.dynamic.slope")
    add("knee", "V", curve.knee, "clutch.dynamic.knee", "clutch.breakaway.knee")
    add("curvature", "N·m/V²", curve.curvature, "clutch.dynamic.curvature")
    breakaway = "clutch.breakaway.slope", "clutch.breakaway.curvature"
    add("breakaway_ratio", "1", clutch.breakaway.slope / curve.slope, *breakaway)
    for x, scale in enumerate(machine.clutch_scale[: len(machine.clutches)], 1):
        add(f"scale_{x}", "1", scale, "clutch_scale")
    add("time_constant", "s", clutch.time_constant, "clutch.time_constant")
    add("delay", "s", delay, "delay", least=CONTROL_PERIOD)
    add("dry_a", "N·m", arm.dry_a, "arm.dry_a", least=low)
    add("dry_b", "N·m", arm.dry_b, "arm.dry_b", least=low)
    add("viscous_a", "N·m·s", arm.viscous_a, "arm.viscous_a", least=low)
    add("viscous_b", "N·m·s", arm.viscous_b, "arm.viscous_b", least=low)
    off_state = "clutch.dynamic.off_state", "clutch.breakaway.off_state"
    add("off_state", "N·m", curve.off_state, *off_state, least=low)
    add("stribeck", "rad/s", clutch.stribeck, "clutch.stribeck", least=USUAL_STRIBECK)
    add("fall_ratio", "1", clutch.fall_ratio, "clutch.fall_ratio")
    add("offset_a", "N·m", offset_a, least=low)
    add("offset_b", "N·m", offset_b, least=low)
    add("force_delay", "s", force_delay, least=CONTROL_PERIOD)
    return numbers
