"""Electromagnetic friction clutch: voltage to torque (paper sections II-B and IV-B, Fig. 5)."""

import math
from typing import Annotated, NamedTuple

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Entry, entrywise, rows


class PerClutch(NamedTuple):
    """One number per clutch: A to ground, B to ground, A to B, A to B by an inverting gear."""

    x1: Annotated[float, Entry("", "clutch 1's {}", name="1")]
    x2: Annotated[float, Entry("", "clutch 2's {}", name="2")]
    x3: Annotated[float, Entry("", "clutch 3's {}", name="3")]
    x4: Annotated[float, Entry("", "clutch 4's {}", name="4")]


CLUTCHES = rows(PerClutch)
"""Places of the clutches' numbers in an array (4,)."""


class Torques(NamedTuple):
    """Torque limits of the four clutches [N·m]."""

    breakaway: Annotated[PerClutch, Entry("N·m", "breakaway torque", name="torque_breakaway")]
    dynamic: Annotated[PerClutch, Entry("N·m", "dynamic torque", name="torque_dynamic")]


class Curve(NamedTuple):
    """Torque over voltage: ``off_state + slope·v + curvature·max(v − knee, 0)²``."""

    slope: Annotated[float, Entry("N·m/V", "slope of the linear segment of the {}")]
    knee: Annotated[float, Entry("V", "voltage at which the quadratic segment of the {} begins")]
    curvature: Annotated[float, Entry("N·m/V²", "curvature of the quadratic segment of the {}")]
    off_state: Annotated[float, Entry("N·m", "{} without voltage")] = 0.0


class Sliding(NamedTuple):
    """How the torque of a slipping clutch depends on its slip velocity."""

    stribeck: Annotated[float, Entry("rad²/s²", "square of the Stribeck velocity, 0 for none")]
    viscous: Annotated[PerClutch, Entry("N·m·s", "viscous friction", name="viscous")]
    creeps: Annotated[float, Entry("1", "1 where a T_k above T_s does not hold in the stick band")]


class Decay(NamedTuple):
    """What half a substep leaves of a first-order lag, 0 where there is none."""

    rise: Annotated[
        float,
        Entry("1", "part of the {}'s lag that half a substep leaves as it rises, 0 for no lag"),
    ]
    fall: Annotated[
        float,
        Entry("1", "part of the {}'s lag that half a substep leaves as it falls, 0 for no lag"),
    ]


@entrywise
@inlined
def curve_torque(curve: Curve, volts: float) -> float:
    """Return the steady torque [N·m] at a voltage [V]: linear, quadratic from the knee on, C1."""
    beyond = volts - curve.knee
    beyond = beyond if beyond > 0.0 else 0.0
    return curve.slope * volts + curve.curvature * beyond * beyond + curve.off_state


@inlined
def steady_torques(breakaway: Curve, dynamic: Curve, volts: PerClutch) -> Torques:
    """Return the torque limits [N·m] that the clutches settle to at constant voltages (Fig. 5)."""
    return Torques(curve_torque(breakaway, volts), curve_torque(dynamic, volts))


@entrywise
@inlined
def product(x: float, y: float) -> float:
    """Return x·y."""
    return x * y


@inlined
def scaled(torques: Torques, scale: PerClutch, strength: PerClutch) -> Torques:
    """Return torque limits [N·m] times two factors for each clutch."""
    factor = product(scale, strength)
    return Torques(product(torques.breakaway, factor), product(torques.dynamic, factor))


@inlined
def lag_left(time: float, time_constant: float) -> float:
    """Return the remaining fraction of a first-order lag after a time [s]."""
    return math.exp(-time / time_constant)


@inlined
def whole_decay(half: Decay) -> Decay:
    """Return what a whole substep leaves of a lag."""
    return Decay(half.rise * half.rise, half.fall * half.fall)


@entrywise
@inlined
def relax(value: float, target: float, decay: Decay) -> float:
    """Advance a first-order lag exactly, by a time that leaves ``decay`` of it."""
    ahead = value - target
    return target + ahead * (decay.fall if ahead > 0.0 else decay.rise)


@entrywise
@inlined
def sought(volts: float, command: float, hysteresis: float) -> float:
    """Return the voltage [V] to which that behind lag and hysteresis tends.

    It is the nearest within ``hysteresis`` of the command: a play operator, or with a lag the
    magnetisation of a core with pinning and eddy currents. In this order of comparisons it depends,
    without hysteresis, on the command alone.
    """
    low, high = command - hysteresis, command + hysteresis
    below = volts if volts < high else high
    return below if below > low else low


@entrywise
@inlined
def heated(heat: float, power: float, time: float, cooling: float) -> float:
    """Return a clutch's heat [J] after it has dissipated a power [W] for a time [s] and cooled."""
    return (heat + abs(power) * time) * math.exp(-time / cooling)


@entrywise
@inlined
def faded(heat: float, fade: float, strength: float) -> float:
    """Return a clutch's torque at a heat [J] and a fade [1/J], relative to a cold one's."""
    return strength / (1.0 + fade * heat)


@inlined
def holding(breakaway: float, dynamic: float) -> float:
    """Return the torque [N·m] that a clutch inside the stick band can hold.

    It is T_s. For T_k > T_s it is T_k: the δω → 0 limit, in which motion persists only above T_k.
    """
    return breakaway if breakaway > dynamic else dynamic


@inlined
def sliding(slip: float, breakaway: float, dynamic: float, part: float, viscous: float) -> float:
    """Return the torque [N·m] of a slipping clutch; ``part`` of T_s − T_k is left at its speed."""
    return dynamic + (breakaway - dynamic) * part + viscous * abs(slip)


@entrywise
@inlined
def capacity(
    slip: float, threshold: float, breakaway: float, dynamic: float, part: float, viscous: float
) -> float:
    """Return the torque limit [N·m] for the next kick by Karnopp's rule (paper Eq. 2)."""
    inside = holding(breakaway, dynamic)
    return inside if abs(slip) < threshold else sliding(slip, breakaway, dynamic, part, viscous)


@entrywise
@inlined
def squared_slip(slip: float, threshold: float) -> float:
    """Return the square of a slip velocity, at least that of the edge of the stick band."""
    square, edge = slip * slip, threshold * threshold
    return square if square > edge else edge


@inlined
def falling(slip: PerClutch, threshold: float, stribeck: float) -> PerClutch:
    """Return ω_s²/(ω_s² + ω²) of each clutch, from ω_s²; within the stick band, as at its edge.

    There is one division for all, since they cost more than the products.
    """
    square = squared_slip(slip, threshold)
    d1, d2 = stribeck + square.x1, stribeck + square.x2
    d3, d4 = stribeck + square.x3, stribeck + square.x4
    d12, d34 = d1 * d2, d3 * d4
    ratio = stribeck / (d12 * d34)
    ratio12, ratio34 = ratio * d34, ratio * d12
    return PerClutch(ratio12 * d2, ratio12 * d1, ratio34 * d4, ratio34 * d3)


@inlined
def capacities(slip: PerClutch, threshold: float, torques: Torques, by: Sliding) -> PerClutch:
    """Return the torque limits [N·m] of the four clutches for the next kick (paper Eq. 2)."""
    ts, tk = torques.breakaway, torques.dynamic
    part = falling(slip, threshold, by.stribeck)
    return capacity(slip, threshold, ts, tk, part, by.viscous)


@entrywise
@inlined
def switches(
    before: float, after: float, threshold: float, breakaway: float, dynamic: float, creeps: float
) -> bool:
    """Return whether a clutch begins to stick, or leaves a band that holds another torque.

    One that may creep has one convex potential for sticking and slipping, and never switches.
    """
    leaves = (abs(after) >= threshold) & (breakaway > dynamic)
    switch = leaves if abs(before) < threshold else before * after <= 0.0
    return switch & (creeps * dynamic <= breakaway)


@entrywise
@inlined
def in_band(
    after: float, threshold: float, breakaway: float, dynamic: float, creeps: float
) -> bool:
    """Return whether a clutch with another torque in the stick band than beyond it may creep."""
    return (abs(after) < threshold) & (creeps * dynamic > breakaway)


@inlined
def any_switches(
    before: PerClutch, after: PerClutch, threshold: float, torques: Torques, creeps: float
) -> bool:
    """Return whether any clutch changes between sticking and slipping, or may creep."""
    ts, tk = torques.breakaway, torques.dynamic
    switch = switches(before, after, threshold, ts, tk, creeps)
    creep = in_band(after, threshold, ts, tk, creeps)
    return (switch.x1 | switch.x2 | switch.x3 | switch.x4) | (
        creep.x1 | creep.x2 | creep.x3 | creep.x4
    )


@inlined
def share_before(before: float, slid: float, threshold: float) -> float:
    """Return the share of a kick after which a clutch switches, 1 if another one does first.

    Parameters
    ----------
    before
        Its slip velocity at the start [rad/s].
    slid
        What the slip would be at the end if no clutch changed [rad/s].
    threshold
        The stick band δω [rad/s].
    """
    # not short of it by rounding, nor by how far the motion is from a straight line
    edge = 1.01 * threshold
    if abs(before) >= threshold:
        return before / (before - slid) if before * slid < 0.0 else 1.0
    return ((edge if slid > 0.0 else -edge) - before) / (slid - before) if abs(slid) > edge else 1.0
