"""How arm, clutches and hands move in a control step."""

from typing import Any

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Records, load, read, store
from pter_gym._engine.hand import move_hand, push_tip
from pter_gym._engine.world import ROW
from pter_gym._physics.arm import Load
from pter_gym._physics.clutch import faded, heated, product
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.scalars import clamp
from pter_gym._physics.step import torques_at
from pter_gym.tasks.path_following._context import CONTEXT


@inlined
def set_strengths(w: Records, i: int, period: float) -> None:
    """Find what friction drift and heat have made of the clutches' torques by now."""
    factor = clamp(1.0 + w[ROW.task.friction_drift, i] * period * w[ROW.step, i], 0.1, 10.0)
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
