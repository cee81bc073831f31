"""What is identified: the numbers of a machine as an optimiser sees them, and as a preset has them."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import SMALLEST, Machine, TorqueCurve

Array = NDArray[np.float64]

NAMES = (
    "log_inertia_a",
    "log_inertia_b",
    "coupling",
    *(f"log_slope_{x}" for x in range(1, 5)),
    "extra",
    "knee",
    "breakaway_ratio",
    "log_time_constant",
    "delay",
    "dry_a",
    "dry_b",
    "viscous_a",
    "viscous_b",
)
"""Coordinates: logarithms of what is positive; the coupling over √(M11·M22); the quadratic segment's share [V] of the
torque over the slope at the highest voltage; its knee [V]; T_s/T_k; the delay [s]; the friction of each axis over its
inertia, dry [rad/s²] and viscous [1/s]."""

INERTIA_A, INERTIA_B, COUPLING = 0, 1, 2
SLOPES = (3, 4, 5, 6)
EXTRA, KNEE, RATIO, TIME_CONSTANT, DELAY = 7, 8, 9, 10, 11
DRY, VISCOUS = (12, 13), (14, 15)

STEPS = np.array([0.01] * 7 + [0.1, 0.1, 0.01, 0.02, 0.5e-3] + [0.05, 0.05, 0.02, 0.02])
"""Steps of central differences: about what moves an event by a substep, so that they see through the raster."""

IGNORANCE = np.array([0.25] * 7 + [math.inf, 2.0, 0.15, 0.25, 5e-3] + [2.0, 2.0, 1.0, 1.0])
"""Largest standard error with which a coordinate counts as seen at all; ``extra`` is judged with the shape."""

LOWEST = np.array([-6.0, -6.0, -0.95, -6.0, -6.0, -6.0, -6.0, -20.0, 0.0, 0.6, math.log(3e-3), -0.01] + [0.0] * 4)
HIGHEST = np.array([5.0, 5.0, 0.95, 6.0, 6.0, 6.0, 6.0, 1e3, 1e3, 4.0, math.log(2.0), 0.1] + [100.0] * 4)

CONTROL_PERIOD = 0.01
"""Control step by which delays are judged [s]."""

ROOM = 0.5
"""Least distance from the knee to the highest voltage [V]."""


@dataclass(frozen=True)
class Shape:
    """How coordinates become a machine.

    Attributes
    ----------
    start
        The machine whose other values are kept.
    top
        Highest voltage at which a clutch slipped [V].
    kept_knee
        The knee from which on the curvature of the start, relative to its slope, is kept; None where both are searched.
    live
        Clutches whose slope is identified, as a mean over which the common slope is taken.
    """

    start: Machine
    top: float
    kept_knee: float | None = None
    live: tuple[int, ...] = (0, 1, 2, 3)

    def machine(self, p: Array) -> Machine:
        """Return the machine at coordinates."""
        inertia_a, inertia_b = math.exp(p[INERTIA_A]), math.exp(p[INERTIA_B])
        slopes = np.exp(p[list(SLOPES)])
        slope = float(slopes[list(self.live)].mean()) if self.live else self.start.clutch.dynamic.slope
        scale = [float(slopes[x] / slope) if x in self.live else self.start.clutch_scale[x] for x in range(4)]
        before = self.start.clutch
        if self.kept_knee is not None:
            knee, curvature = self.kept_knee, slope * before.dynamic.curvature / before.dynamic.slope
        else:
            knee = float(p[KNEE])
            curvature = slope * float(p[EXTRA]) / max(self.top - knee, 0.5 * ROOM) ** 2
        if curvature < 0.0:  # what falls within the log must not fall below zero slope beyond it
            curvature = max(curvature, -0.49 * slope / max(before.voltage_max - knee, 1e-6))
        dynamic = TorqueCurve(slope=slope, knee=knee, curvature=curvature)
        clutch = replace(
            before,
            dynamic=dynamic,
            breakaway=dynamic.scaled(float(p[RATIO])),
            time_constant=math.exp(p[TIME_CONSTANT]),
        )
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
        return replace(self.start, arm=arm, clutch=clutch, clutch_scale=tuple(scale))

    def coordinates(self, machine: Machine, delay: float = 0.0) -> Array:
        """Return the coordinates of a machine; a knee beyond the log is put into it, without a quadratic segment."""
        arm, curve = machine.arm, machine.clutch.dynamic
        inside = curve.knee <= self.top - ROOM
        knee = curve.knee if inside else max(0.5 * self.top, 0.0)
        extra = curve.curvature / curve.slope * (self.top - knee) ** 2 if inside else 0.0
        return np.array(
            [
                math.log(arm.inertia_a),
                math.log(arm.inertia_b),
                arm.coupling / math.sqrt(arm.inertia_a * arm.inertia_b),
                *(math.log(max(curve.slope * scale, SMALLEST)) for scale in machine.clutch_scale),
                extra,
                knee,
                machine.clutch.breakaway.slope / curve.slope,
                math.log(machine.clutch.time_constant),
                delay,
                arm.dry_a / arm.inertia_a,
                arm.dry_b / arm.inertia_b,
                arm.viscous_a / arm.inertia_a,
                arm.viscous_b / arm.inertia_b,
            ]
        ).clip(LOWEST, self.highest)

    @property
    def highest(self) -> Array:
        """Upper bounds of the coordinates."""
        bounds = HIGHEST.copy()
        bounds[KNEE] = max(self.top - ROOM, 1e-3)
        return bounds


@dataclass(frozen=True)
class Quantity:
    """One number of the result.

    Attributes
    ----------
    name, unit, meaning
        As the report shows it.
    value
        In its unit.
    scale
        By what its error is judged: its own size, or what is said in ``judged``.
    judged
        What the scale is, where it is not the value.
    place
        Section and field of the preset; empty for what follows from them.
    least
        The smallest value that there is.
    """

    name: str
    unit: str
    meaning: str
    value: float
    scale: float
    judged: str = ""
    place: str = ""
    least: float = -math.inf


def quantities(machine: Machine, delay: float, top: float) -> list[Quantity]:
    """Return the numbers of a machine and a delay [s] that are reported, always the same ones in the same order."""
    arm, curve = machine.arm, machine.clutch.dynamic
    found: list[Quantity] = []

    def add(
        name: str, unit: str, meaning: str, value: float, place: str = "", scale: float = 0.0, judged: str = ""
    ) -> None:
        found.append(Quantity(name, unit, meaning, value, scale or abs(value), judged, place))

    add("inertia_a", "kg·m²", "inertia about axis A", arm.inertia_a, "arm.inertia_a")
    add("inertia_b", "kg·m²", "inertia about axis B", arm.inertia_b, "arm.inertia_b")
    middle = math.sqrt(arm.inertia_a * arm.inertia_b)
    add("coupling", "kg·m²", "coupling of the axes", arm.coupling, "arm.coupling", middle, "of √(M11·M22)")
    for share in (0.25, 0.5, 0.75, 1.0):
        meaning = f"mean dynamic torque at {share * top:.3g}\u00a0V"
        add(f"torque_{round(100 * share)}", "N·m", meaning, curve.torque(share * top))
    add("slope", "N·m/V", "slope of the dynamic torque", curve.slope, "clutch.slope")
    add("knee", "V", "where the quadratic segment begins", curve.knee, "clutch.knee")
    add("curvature", "N·m/V²", "curvature of the quadratic segment", curve.curvature, "clutch.curvature")
    ratio = machine.clutch.breakaway.slope / curve.slope
    add("breakaway_ratio", "1", "breakaway over dynamic torque", ratio, "clutch.breakaway_ratio")
    for x, scale in enumerate(machine.clutch_scale[: len(machine.clutches)], 1):
        add(f"scale_{x}", "1", f"torque of clutch {x} over the mean", scale, "clutch.scale")
    add("time_constant", "s", "lag of the clutches", machine.clutch.time_constant, "clutch.time_constant")
    add(
        "delay", "s", "from voltage to motion", delay, "sensing.delay", max(delay, CONTROL_PERIOD), "of it, or of 10 ms"
    )
    smallest = curve.torque(0.25 * top)
    for name, unit, meaning, judged in (
        ("dry", "N·m", "dry friction of axis {}", "of it, or of torque_25"),
        ("viscous", "N·m·s", "viscous friction of axis {}", "of it, or of torque_25 at 1 rad/s"),
    ):
        for axis in "ab":
            value = getattr(arm, f"{name}_{axis}")
            place = f"arm.{name}_{axis}"
            about = meaning.format(axis.upper())
            found.append(Quantity(f"{name}_{axis}", unit, about, value, max(value, smallest), judged, place, 0.0))
    return found
