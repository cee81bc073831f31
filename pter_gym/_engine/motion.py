"""How arm, clutches and hands move in a control step."""

from typing import Any

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Records, entrywise, load, read, store
from pter_gym._engine.hand import move_hand, push_tip
from pter_gym._engine.world import ROW
from pter_gym._physics.arm import Load
from pter_gym._physics.clutch import PerClutch, faded, heated, product
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.scalars import clamp
from pter_gym._physics.step import torques_at
from pter_gym.tasks.path_following._context import CONTEXT


@entrywise
@inlined
def applied(command: float, held: float, after: float, step: float) -> float:
    """Return the voltage [V] of a clutch: its command, or what it holds once it has failed."""
    return held if (step >= after) & (held >= 0.0) else command


@inlined
def applied_volts(w: Records, i: int) -> PerClutch:
    """Return the voltages [V] of the clutches, which follow the command unless they have failed."""
    failing, step = load(w, ROW.task.failures, i), w[ROW.step, i]
    return applied(load(w, ROW.command, i), failing.volts, failing.after, step)


@entrywise
@inlined
def share_left(share: float, after: float, step: float) -> float:
    """Return the share of its torque that a clutch gives, 1 until it fails."""
    return share if step >= after else 1.0


@inlined
def shares_left(w: Records, i: int) -> PerClutch:
    """Return the shares of their torques that the clutches give by now."""
    failing = load(w, ROW.task.failures, i)
    return share_left(failing.torque, failing.after, w[ROW.step, i])


@inlined
def set_clutches(w: Records, i: int, period: float) -> None:
    """Find the clutches' voltages, and what drift, failures and heat have made of their torques."""
    store(w, ROW.volts, i, applied_volts(w, i))
    drift = clamp(1.0 + w[ROW.task.friction_drift, i] * period * w[ROW.step, i], 0.1, 10.0)
    factor = product(drift, shares_left(w, i))
    store(w, ROW.strength, i, faded(load(w, ROW.heat, i), w[ROW.machine.fade, i], factor))


@inlined
def load_on(w: Records, i: int) -> Load:
    """Return what the hand of a world does to the arm."""
    force = load(w, ROW.force, i)
    to = load(w, ROW.target.position, i)
    return Load(force.x, force.y, 0.0, 0.0, to.x, to.y)


@inlined
def move_hands(w: Records, lanes: int, h: float, whole: bool, guides: bool) -> None:
    """Advance the hands of the first ``lanes`` worlds, and find their forces for the next kick."""
    for i in range(lanes):
        move_hand(w, i, h, whole, guides)
    for i in range(lanes):
        push_tip(w, i, guides)


@inlined
def no_arrangements(w: Records, lanes: int, constants: Records) -> None:
    """Leave the paper's clutches as they are."""


@inlined
def take_arrangements(w: Records, lanes: int, constants: Records) -> None:
    """Read the arrangement of the first ``lanes`` worlds."""
    for i in range(lanes):
        store(
            w, ROW.arrangement, i, read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i]))
        )


def heater(arrangement_at: Any) -> Any:
    """Return what heats clutches of ``arrangement_at``; see ``substep_on``."""

    @inlined
    def heat_clutches(w: Records, i: int, period: float) -> None:
        """Add the heat of a control step, from torques and slip velocities at its end."""
        q, heat, cooling = load(w, ROW.motion, i), load(w, ROW.heat, i), w[ROW.machine.cooling, i]
        slip = slip_velocities(q.omega_a, q.omega_b, arrangement_at(w, i))
        store(w, ROW.heat, i, heated(heat, product(load(w, ROW.torque, i), slip), period, cooling))

    return heat_clutches


def torque_sensor(arrangement_at: Any) -> Any:
    """Return what finds the torques of clutches of ``arrangement_at``."""

    @inlined
    def sense_torques(w: Records, i: int) -> None:
        """Find the torques [N·m] that the clutches generate now."""
        q, machine, torques = (
            load(w, ROW.motion, i),
            load(w, ROW.machine, i),
            load(w, ROW.torques, i),
        )
        store(
            w, ROW.torque, i, torques_at(q, machine, load_on(w, i), torques, arrangement_at(w, i))
        )

    return sense_torques
