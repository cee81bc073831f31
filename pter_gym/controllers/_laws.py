"""Guiding laws as scalar functions: one observation in, four voltages out.

A guiding law has a desired tip force, a brake along the path and a spring and a damper normal to
it, which Jᵀ maps to the joints. Its *steering* makes clutch torques of that. The torque table and,
if it has a gain, the torque loop make voltages of these::

    steering(g, tip, nominal, want, memory, arrangement) -> PerClutch

``g`` has the gains at the commanded pace by name and ``want`` the desired joint torques [N·m]; the
torques that it returns are in N·m. ``arrangement`` is None for the paper's clutches.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from pter_gym._compiled.compiler import compiled, inlined
from pter_gym._compiled.records import entrywise, read
from pter_gym._physics.arm import (
    Linkage,
    Motion,
    PerLink,
    UnitVector,
    Vector,
    joint_torque,
    tip_velocity,
)
from pter_gym._physics.arrangement import Arrangement, OptionalArrangement
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.scalars import clamp
from pter_gym.controllers._gains import (
    ARRANGEMENT,
    MEMORY,
    NOMINAL,
    RELEASED,
    Entries,
    Nominal,
    clutch_voltage,
    gains_reader,
)
from pter_gym.tasks.path_following._observation import OBS

Law = Callable[..., Any]
"""``law(obs, scales, gains, memory) -> PerClutch``; see ``pter_gym.controllers._gains``."""

BRAKE_LIMIT = 200.0
"""Largest magnitude of the force along the path that the pace's integral comes to [N]."""

START_PROGRESS = 0.02
"""Part of the path within which an episode begins."""

STUCK = 0.02
"""A clutch that slips more slowly is released while the tip leaves the path [rad/s]."""

JOINED_MIDWAY = 1e6
"""Control steps that no episode has."""


class Tip(NamedTuple):
    """The arm and its position relative to the path as a law sees them, in SI.

    Attributes
    ----------
    arm, q
        Nominal arm, and its motion.
    velocity
        Velocity of the tip [m/s].
    heading, error, curvature
        Unit vector along the path, distance from it [m], and its curvature there [1/m].
    slip
        Slip velocities of the clutches [rad/s].
    """

    arm: Linkage
    q: Motion
    velocity: Vector
    heading: UnitVector
    error: float
    curvature: float
    slip: PerClutch


def is_ours(function: Any) -> bool:
    """Return whether a compiled function is of this package, whose bounds need no checks."""
    return str(getattr(function, "__module__", "")).startswith("pter_gym.")


@inlined
def physical(obs: Entries, scales: Entries, at: float) -> float:
    """Return an entry of an observation in its unit."""
    return obs[at] * scales[at]


@inlined
def observed_tip(
    obs: Entries, scales: Entries, nominal: Nominal, arrangement: OptionalArrangement
) -> Tip:
    """Return the tip as estimated from the observation and the nominal machine."""
    q = Motion(
        0.0,  # no law asks for the angles themselves
        0.0,
        physical(obs, scales, OBS.omega_a),
        physical(obs, scales, OBS.omega_b),
        float(obs[OBS.cos_a]),
        float(obs[OBS.sin_a]),
        float(obs[OBS.cos_b]),
        float(obs[OBS.sin_b]),
    )
    v_x, v_y = tip_velocity(nominal.arm, q)
    return Tip(
        nominal.arm,
        q,
        Vector(v_x, v_y),
        UnitVector(float(obs[OBS.heading.cos]), float(obs[OBS.heading.sin])),
        physical(obs, scales, OBS.normal_error),
        physical(obs, scales, OBS.curvature),
        slip_velocities(q.omega_a, q.omega_b, arrangement),
    )


@inlined
def speed_along(tip: Tip) -> float:
    """Return the speed of the tip along the path [m/s]."""
    return tip.velocity.x * tip.heading.cos + tip.velocity.y * tip.heading.sin


@inlined
def speed_across(tip: Tip) -> float:
    """Return the speed of the tip normal to the path [m/s], positive to its left."""
    return tip.velocity.y * tip.heading.cos - tip.velocity.x * tip.heading.sin


@inlined
def is_lost(g: Any, tip: Tip) -> bool:
    """Return whether the tip is beyond the gain ``release`` and moves away from the path."""
    return (abs(tip.error) * g.release > 1.0) & (tip.error * speed_across(tip) > 0.0)


@inlined
def wanted_force(g: Any, tip: Tip, pace: float, integral: float) -> tuple[float, float]:
    """Return the tip force [N] of a spring and a damper normal to the path and a brake along it.

    The brake is a damper on the excess of the speed over a fraction of the commanded pace, plus
    ``integral`` [N]. It never pushes. Backwards it is a plain damper.
    """
    speed = speed_along(tip)
    brake = g.damping_tangential * (speed - g.pace_fraction * pace) + integral
    brake = brake if brake > 0.0 else 0.0
    along = -brake if speed > 0.0 else -g.damping_tangential * speed
    across = -g.stiffness * tip.error - g.damping_normal * speed_across(tip)
    return (
        along * tip.heading.cos - across * tip.heading.sin,
        along * tip.heading.sin + across * tip.heading.cos,
    )


@inlined
def steps_before(obs: Entries, memory: Entries) -> float:
    """Return the number of earlier control steps in the episode, and count this one.

    An episode that the law joins midway has had ``JOINED_MIDWAY`` steps.
    """
    steps = memory[MEMORY.steps]
    joins = (steps == 0.0) & (float(obs[OBS.progress]) >= START_PROGRESS)
    before = JOINED_MIDWAY if joins else steps
    memory[MEMORY.steps] = before + 1.0
    return before


@inlined
def pace_integral(g: Any, tip: Tip, pace: float, memory: Entries) -> float:
    """Return the pace's integral [N] after a control step, which adds gain·(speed − pace)."""
    more = g.pace_integral * (speed_along(tip) - pace)
    memory[MEMORY.brake] = clamp(memory[MEMORY.brake] + more, -BRAKE_LIMIT, BRAKE_LIMIT)
    return memory[MEMORY.brake]


@inlined
def demanded_force(
    g: Any, tip: Tip, pace: float, before: float, memory: Entries
) -> tuple[bool, float, float]:
    """Return whether a law still grips after so many control steps, and the tip force [N]."""
    gripping = g.grip - before >= 0.5
    integral = 0.0 if gripping else pace_integral(g, tip, pace, memory)
    force_x, force_y = wanted_force(g, tip, pace, integral)
    return gripping, force_x, force_y


@entrywise
@inlined
def looped_voltage(
    obs: Entries,
    scales: Entries,
    gains: Entries,
    g: Any,
    lost: bool,
    least: float,
    scale: float,
    wanted: float,
    slip: float,
    sensor: float,
) -> float:
    """Return the voltage [V] of a clutch, after the torque loop if it has a gain.

    It is at least ``least``, except for a missing clutch. One that sticks while the tip is lost is
    ``RELEASED``.
    """
    generated = physical(obs, scales, sensor) if g.feedback != 0.0 else 0.0
    volts = max(
        least if scale > 0.0 else 0.0, clutch_voltage(gains, g, scale, wanted, slip, generated)
    )
    return RELEASED if lost & (abs(slip) < STUCK) else volts


@inlined
def paper_clutches(gains: Entries) -> None:
    """Return None, the arrangement of the paper's clutches: its branches compile to nothing."""


@inlined
def declared_clutches(gains: Entries) -> Arrangement:
    """Return the ``Arrangement`` at the end of the gains."""
    return read(gains, ARRANGEMENT, gains.shape[0])


@cache
def guiding_law(steering: Law, record: type[Any], arrangement_at: Law) -> Law:
    """Return the guiding law with a steering, compiled with bounds checks if that is a user's.

    Parameters
    ----------
    steering
        Makes clutch torques of the desired joint torques, as above.
    record
        Record of the law's gains.
    arrangement_at
        ``paper_clutches`` or ``declared_clutches``.
    """
    read_gains = gains_reader(record)

    def guide(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
        """Return the voltages of a guiding law."""
        pace = physical(obs, scales, OBS.pace)
        nominal = read(gains, NOMINAL, 0)
        arrangement = arrangement_at(gains)
        g = read_gains(gains, pace)
        tip = observed_tip(obs, scales, nominal, arrangement)
        gripping, force_x, force_y = demanded_force(g, tip, pace, steps_before(obs, memory), memory)
        want_a, want_b = joint_torque(tip.arm, tip.q, force_x, force_y)
        wanted = steering(g, tip, nominal, PerLink(want_a, want_b), memory, arrangement)
        least = nominal.voltage_max if gripping else 0.0
        return looped_voltage(
            obs,
            scales,
            gains,
            g,
            is_lost(g, tip),
            least,
            nominal.scale,
            wanted,
            tip.slip,
            OBS.torque,
        )

    guide.__module__ = steering.__module__
    return (inlined if is_ours(steering) else compiled)(guide)
