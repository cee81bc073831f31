"""What a control step records: the telemetry of one world."""

from typing import Any

from pter_gym._compiled.compiler import device, outlined
from pter_gym._compiled.records import load, read, write
from pter_gym._engine.world import ROW
from pter_gym._physics.arm import PerLink, Vector, kinetic_energy, tip_position, tip_velocity
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import mode_of, slip_velocities
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH
from pter_gym.tasks.path_following._telemetry import COLUMN


@outlined
def record_reset(w: Any, i: int, telemetry: Any, t: int, world: int, constants: Any) -> None:
    """Write the telemetry (T, N, K) of a world that is not stepping: its pose, the rest zero."""
    for column in range(telemetry.shape[2]):
        telemetry[t, world, column] = 0.0
    record_pose(w, i, telemetry[t, world], 0.0, constants)


@device
def record_pose(w: Any, i: int, row: Any, time: float, constants: Any) -> None:
    """Write what the telemetry of a world, (K,), says of the pose, of machine and task."""
    arm = load(w, ROW.machine.arm, i)
    q = load(w, ROW.motion, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    context_at = w[ROW.context_at, i]
    row[COLUMN.time] = time
    write(row, COLUMN.theta, PerLink(q.theta_a, q.theta_b))
    write(row, COLUMN.tip, Vector(x, y))
    write(row, COLUMN.tip_velocity, Vector(v_x, v_y))
    row[COLUMN.arc_length] = w[ROW.foot.arc_length, i]
    row[COLUMN.reached] = w[ROW.reached, i]
    row[COLUMN.normal_error] = w[ROW.foot.normal_error, i]
    row[COLUMN.context] = (context_at - w[ROW.draws_from, i]) / CONTEXT_WIDTH
    own = read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i]))
    papers = own.number == 0.0
    row[COLUMN.mode] = mode_of(q.omega_a, q.omega_b) if papers else mode_of(q.omega_a, q.omega_b, own)
    row[COLUMN.kinetic_energy] = kinetic_energy(arm, q)
    write(row, COLUMN.volts, load(w, ROW.command, i))
    write(row, COLUMN.told, read(constants, CONTEXT.told, int(context_at)))


@device
def tip_acceleration(w: Any, i: int, period: float) -> Vector:
    """Return the mean acceleration of the tip over a control step [m/s²]."""
    v_x, v_y = tip_velocity(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    return Vector((v_x - w[ROW.start_velocity.x, i]) / period, (v_y - w[ROW.start_velocity.y, i]) / period)


@outlined
def record_step(w: Any, i: int, telemetry: Any, t: int, world: int, period: float, constants: Any) -> None:
    """Write the telemetry (T, N, K) of a control step."""
    row = telemetry[t, world]
    record_pose(w, i, row, w[ROW.step, i] * period, constants)
    q = load(w, ROW.motion, i)
    own = read(constants, CONTEXT.arrangement, int(w[ROW.context_at, i]))
    papers = own.number == 0.0
    slip = slip_velocities(q.omega_a, q.omega_b) if papers else slip_velocities(q.omega_a, q.omega_b, own)
    torque = load(w, ROW.torque, i)
    write(row, COLUMN.acceleration, tip_acceleration(w, i, period))
    write(row, COLUMN.force, total_force(w, i))
    write(row, COLUMN.torque, torque)
    power = PerClutch(torque.x1 * slip.x1, torque.x2 * slip.x2, torque.x3 * slip.x3, torque.x4 * slip.x4)
    write(row, COLUMN.power, power)
    write(row, COLUMN.energy, load(w, ROW.energy, i))
    write(row, COLUMN.terms, load(w, ROW.terms, i))
    row[COLUMN.reward] = w[ROW.reward, i]
    row[COLUMN.is_success] = w[ROW.end.success, i]
    row[COLUMN.terminated] = w[ROW.end.terminated, i]


@device
def total_force(w: Any, i: int) -> Vector:
    """Return the force of the hand on the tip at the control instant [N], that of its spring and damper included."""
    arm = load(w, ROW.machine.arm, i)
    q = load(w, ROW.motion, i)
    force = load(w, ROW.force, i)
    to = load(w, ROW.target.position, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    return Vector(
        force.x + arm.stiffness * (to.x - x) - arm.damping * v_x,
        force.y + arm.stiffness * (to.y - y) - arm.damping * v_y,
    )
