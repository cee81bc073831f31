# pyright: standard
"""The coordinates of the search, the machine that they are, and the numbers that a user reads."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.fields import MIN_POSITIVE
from pter_gym.params import Machine, TorqueCurve

Array = NDArray[np.float64]


class Search(NamedTuple):
    """How a coordinate is searched.

    A small change of it, the largest standard error with which it counts as seen at all, its
    bounds, and why a log does not show it.
    """

    step: float
    max_error: float
    low: float
    high: float
    unseen: str


_STEP = "no voltage was stepped while a clutch slipped, or the rows are too coarse"
_SCALE, _INERTIA, _DRY, _VISCOUS, _OFFSET = (
    Search(*numbers, f"the log hardly shows {what}")
    for numbers, what in (
        ((0.01, 0.25, -6.0, 6.0), "this clutch slipping"),
        ((0.01, 0.25, -6.0, 5.0), "the inertia of this link"),
        ((0.05, 2.0, 0.0, 100.0), "the friction of this axis"),
        ((0.02, 1.0, 0.0, 100.0), "the friction of this axis"),
        ((0.05, 2.0, -100.0, 100.0), "a constant torque on this axis"),
    )
)


class Coordinates(NamedTuple):
    """What is searched, each under the name of the reported number that is unknown without it.

    Logarithms of the slopes of the four torque curves; the quadratic segment's share [V] of the
    torque over the slope at the highest voltage, and its knee [V]; T_s/T_k; the logarithm of the
    time constant; the delay [s]; the off-state torque [N·m]; the Stribeck velocity [rad/s]; the
    logarithm of the time constant of a falling torque over that of a rising one. Then logarithms of
    the inertias; the coupling over √(M11·M22); the friction of each axis over its inertia, dry
    [rad/s²] and viscous [1/s]; a constant torque on each axis over its inertia [rad/s²]; how late
    forces are recorded [s].
    """

    scale_1: Annotated[float, _SCALE]
    scale_2: Annotated[float, _SCALE]
    scale_3: Annotated[float, _SCALE]
    scale_4: Annotated[float, _SCALE]
    curvature: Annotated[
        float, Search(0.1, math.inf, -20.0, 1e3, "torque is straight where clutches slipped")
    ]
    knee: Annotated[
        float, Search(0.1, 2.0, 0.0, 1e3, "clutches slipped at one voltage above the knee only")
    ]
    breakaway_ratio: Annotated[
        float, Search(0.01, 0.15, 0.6, 4.0, "the log hardly shows breakaways")
    ]
    time_constant: Annotated[float, Search(0.02, 0.25, math.log(3e-3), math.log(2.0), _STEP)]
    delay: Annotated[float, Search(0.5e-3, 5e-3, -0.01, 0.1, _STEP)]
    off_state: Annotated[
        float, Search(0.02, 1.0, 0.0, 100.0, "the log hardly shows torque without voltage")
    ]
    stribeck: Annotated[
        float, Search(0.02, 0.3, 0.0, 3.0, "the log hardly shows how torque varies with slip")
    ]
    fall_ratio: Annotated[float, Search(0.02, 0.25, math.log(0.1), math.log(10.0), _STEP)]
    inertia_a: Annotated[float, _INERTIA]
    inertia_b: Annotated[float, _INERTIA]
    coupling: Annotated[
        float, Search(0.01, 0.25, -0.95, 0.95, "the log hardly shows the axes' coupling")
    ]
    dry_a: Annotated[float, _DRY]
    dry_b: Annotated[float, _DRY]
    viscous_a: Annotated[float, _VISCOUS]
    viscous_b: Annotated[float, _VISCOUS]
    offset_a: Annotated[float, _OFFSET]
    offset_b: Annotated[float, _OFFSET]
    force_delay: Annotated[
        float, Search(0.5e-3, 5e-3, -0.1, 0.1, "the log hardly shows when forces act")
    ]


SEARCHES: dict[str, Search] = {
    name: hint.__metadata__[0]
    for name, hint in get_type_hints(Coordinates, include_extras=True).items()
}
"""How each coordinate is searched, by name."""

NAMES = tuple(SEARCHES)
COUNT = len(NAMES)
AT = {name: place for place, name in enumerate(NAMES)}
"""Place of each coordinate in an array."""

SCALES = NAMES[:4]
CLUTCH_TERMS = ("off_state", "stribeck", "fall_ratio")
CLUTCH_NAMES = NAMES[: NAMES.index("fall_ratio") + 1]
TERMS = (*CLUTCH_TERMS, "offset_a", "offset_b", "force_delay")
"""Coordinates that the paper's machine does not have: searched only if a log asks for them."""

STEPS, MAX_ERRORS, LOWEST = (
    np.array([getattr(each, field) for each in SEARCHES.values()])
    for field in ("step", "max_error", "low")
)

CONTROL_PERIOD, USUAL_STRIBECK, ROOM = 0.01, 0.1, 0.5
"""Control step by which delays are judged [s], Stribeck velocity by which lower ones are [rad/s],
and least distance from the knee to the highest voltage [V]."""


def places(names: Iterable[str]) -> list[int]:
    """Return the places of coordinates in an array."""
    return [AT[name] for name in names]


def along(name: str, size: float) -> Array:
    """Return the change of one coordinate by so much, shape (22,)."""
    return size * np.eye(COUNT)[AT[name]]


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
        c, before, slopes = Coordinates(*p.tolist()), self.start.clutch, np.exp(p[:4])
        slope = float(slopes[list(self.live)].mean()) if self.live else before.dynamic.slope
        scale = list(self.start.clutch_scale)
        for x in self.live:
            scale[x] = float(slopes[x] / slope)
        if self.kept_knee is not None:
            knee = self.kept_knee
            curvature = slope * before.dynamic.curvature / before.dynamic.slope
        else:
            knee = c.knee
            curvature = slope * c.curvature / max(self.top - knee, 0.5 * ROOM) ** 2
        if curvature < 0.0:  # what falls within the log must not fall below zero slope beyond it
            curvature = max(curvature, -0.49 * slope / max(before.voltage_max - knee, 1e-6))
        dynamic = TorqueCurve(slope=slope, knee=knee, curvature=curvature, off_state=c.off_state)
        clutch = replace(
            before,
            dynamic=dynamic,
            breakaway=dynamic.scaled(c.breakaway_ratio),
            time_constant=math.exp(c.time_constant),
            stribeck=c.stribeck,
            fall_ratio=math.exp(c.fall_ratio),
        )
        inertia_a, inertia_b = math.exp(c.inertia_a), math.exp(c.inertia_b)
        arm = replace(
            self.start.arm,
            inertia_a=inertia_a,
            inertia_b=inertia_b,
            coupling=c.coupling * math.sqrt(inertia_a * inertia_b),
            dry_a=c.dry_a * inertia_a,
            dry_b=c.dry_b * inertia_b,
            viscous_a=c.viscous_a * inertia_a,
            viscous_b=c.viscous_b * inertia_b,
        )
        delay = max(c.delay, 0.0)
        return replace(self.start, arm=arm, clutch=clutch, clutch_scale=tuple(scale), delay=delay)

    def offsets(self, p: Array) -> tuple[float, float]:
        """Return the constant torques on the axes at coordinates [N·m]."""
        c = Coordinates(*p.tolist())
        return c.offset_a * math.exp(c.inertia_a), c.offset_b * math.exp(c.inertia_b)

    def coordinates(self, machine: Machine, delay: float = 0.0) -> Array:
        """Return the coordinates of a machine; a knee beyond the log is moved into it."""
        arm, clutch, curve = machine.arm, machine.clutch, machine.clutch.dynamic
        inside = curve.knee <= self.top - ROOM
        knee = curve.knee if inside else max(0.5 * self.top, 0.0)
        slopes = (math.log(max(curve.slope * k, MIN_POSITIVE)) for k in machine.clutch_scale)
        found = Coordinates(
            *slopes,
            curvature=curve.curvature / curve.slope * (self.top - knee) ** 2 if inside else 0.0,
            knee=knee,
            breakaway_ratio=clutch.breakaway.slope / curve.slope,
            time_constant=math.log(clutch.time_constant),
            delay=delay,
            off_state=curve.off_state,
            stribeck=clutch.stribeck,
            fall_ratio=math.log(clutch.fall_ratio),
            inertia_a=math.log(arm.inertia_a),
            inertia_b=math.log(arm.inertia_b),
            coupling=arm.coupling / math.sqrt(arm.inertia_a * arm.inertia_b),
            dry_a=arm.dry_a / arm.inertia_a,
            dry_b=arm.dry_b / arm.inertia_b,
            viscous_a=arm.viscous_a / arm.inertia_a,
            viscous_b=arm.viscous_b / arm.inertia_b,
            offset_a=0.0,
            offset_b=0.0,
            force_delay=0.0,
        )
        return self.within(np.array(found))

    @property
    def highest(self) -> Array:
        """Upper bounds of the coordinates."""
        bounds = np.array([each.high for each in SEARCHES.values()])
        bounds[AT["knee"]] = max(self.top - ROOM, 1e-3)
        return bounds

    def within(self, p: Array) -> Array:
        """Return coordinates within their bounds."""
        return p.clip(LOWEST, self.highest)

    def around(self, p: Array, name: str, share: float) -> tuple[Array, Array]:
        """Return coordinates with one a share of its step above, and below, within bounds."""
        change = along(name, share * SEARCHES[name].step)
        return self.within(p + change), self.within(p - change)

    def quantities(self, p: Array) -> "list[Quantity]":
        """Return the reported numbers at coordinates."""
        c = Coordinates(*p.tolist())
        return quantities(self.machine(p), c.delay, self.top, self.offsets(p), c.force_delay)


PRODUCTS = {
    "slope": ("N·m/V", "slope", "breakaway_ratio"),
    "curvature": ("N·m/V²", "curvature", "breakaway_ratio"),
    "off_state": ("N·m", "off_state", "breakaway_ratio"),
}
"""Fields of the breakaway torque: their units, and the numbers of which they are products."""


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
    found: list[Quantity] = []

    def add(name: str, unit: str, value: float, *fields: str, least: float = 0.0) -> None:
        found.append(Quantity(name, unit, value, max(abs(value), least), fields))

    add("inertia_a", "kg·m²", arm.inertia_a, "arm.inertia_a")
    add("inertia_b", "kg·m²", arm.inertia_b, "arm.inertia_b")
    both = math.sqrt(arm.inertia_a * arm.inertia_b)
    add("coupling", "kg·m²", arm.coupling, "arm.coupling", least=both)
    for percent in (25, 50, 75, 100):
        add(f"torque_{percent}", "N·m", curve.torque(0.01 * percent * top))
    add("slope", "N·m/V", curve.slope, "clutch.dynamic.slope")
    add("knee", "V", curve.knee, "clutch.dynamic.knee", "clutch.breakaway.knee")
    add("curvature", "N·m/V²", curve.curvature, "clutch.dynamic.curvature")
    add("breakaway_ratio", "1", clutch.breakaway.slope / curve.slope)
    for name, scale in zip(SCALES, machine.clutch_scale[: len(machine.clutches)], strict=False):
        add(name, "1", scale, "clutch_scale")
    add("time_constant", "s", clutch.time_constant, "clutch.time_constant")
    add("delay", "s", delay, "delay", least=CONTROL_PERIOD)
    for kind, unit in (("dry", "N·m"), ("viscous", "N·m·s")):
        for axis in "ab":
            name = f"{kind}_{axis}"
            add(name, unit, getattr(arm, name), f"arm.{name}", least=low)
    add("off_state", "N·m", curve.off_state, "clutch.dynamic.off_state", least=low)
    add("stribeck", "rad/s", clutch.stribeck, "clutch.stribeck", least=USUAL_STRIBECK)
    add("fall_ratio", "1", clutch.fall_ratio, "clutch.fall_ratio")
    add("offset_a", "N·m", offsets[0], least=low)
    add("offset_b", "N·m", offsets[1], least=low)
    add("force_delay", "s", force_delay, least=CONTROL_PERIOD)
    return found
