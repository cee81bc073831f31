"""What the sensors of a world read, and the observation that comes of it."""

import math
from typing import Any

import numpy as np

from pter_gym._compiled.compiler import device, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import load, store
from pter_gym._engine.hand import hand_force
from pter_gym._engine.world import CONFIG, CONFIG_WIDTH, CONSTANT_ROWS, ROW, Reading
from pter_gym._physics.arm import Motion, PerLink, tip_position, tip_velocity
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import between
from pter_gym.hands._model import unit_vector
from pter_gym.paths._projection import project
from pter_gym.tasks.path_following._observation import BOUND, ENTRIES, observation
from pter_gym.tasks.path_following._situation import PathVector, Situation, situation
from pter_gym.tasks.path_following._specification import MAX_DELAY

_NOISE_STREAM = np.uint64(0x4E4F495345)

_FIRST_SEEN = ROW.seen.cos_a
_FIRST_INVERSE_SCALE = CONFIG.inverse_scale.cos_a


@device
def situated(w: Any, i: int) -> Situation:
    """Return where a world is with respect to its path."""
    v_x, v_y = tip_velocity(load(w, ROW.machine.arm, i), load(w, ROW.motion, i))
    return situation(load(w, ROW.foot, i), v_x, v_y)


@device
def gaussians(seed: np.uint64, episode: np.uint64, draw: int) -> tuple[float, float, float, float]:
    """Return four independent standard normal numbers (Box and Muller)."""
    u0, u1, u2, u3 = uniform4(seed, _NOISE_STREAM, np.uint64(draw), episode)
    r = math.sqrt(-2.0 * math.log(1.0 - u0))
    s = math.sqrt(-2.0 * math.log(1.0 - u2))
    return (
        r * math.cos(2.0 * np.pi * u1),
        r * math.sin(2.0 * np.pi * u1),
        s * math.cos(2.0 * np.pi * u3),
        s * math.sin(2.0 * np.pi * u3),
    )


@outlined
def take_reading(w: Any, i: int, seed: np.uint64, episode: np.uint64) -> None:
    """Let the sensors of a world read, and keep what they read before."""
    for age in range(MAX_DELAY, 0, -1):
        store(w, ROW.readings[age], i, load(w, ROW.readings[age - 1], i))
    step = int(w[ROW.step, i])
    sensing = load(w, ROW.task.sensing, i)
    q = load(w, ROW.motion, i)
    torque = load(w, ROW.torque, i)
    force = hand_force(w, i)
    g0, g1, g2, g3 = gaussians(seed, episode, 2 * step)
    n0, n1, n2, n3 = gaussians(seed, episode, 2 * step + 1)
    reading = Reading(
        theta=PerLink(
            quantised(q.theta_a, sensing.angle_resolution),
            quantised(q.theta_b, sensing.angle_resolution),
        ),
        omega=PerLink(q.omega_a + sensing.velocity_noise * g0, q.omega_b + sensing.velocity_noise * g1),
        torque=PerClutch(
            torque.x1 + sensing.torque_noise * n0,
            torque.x2 + sensing.torque_noise * n1,
            torque.x3 + sensing.torque_noise * n2,
            torque.x4 + sensing.torque_noise * n3,
        ),
        force=PathVector(force.along + sensing.force_noise * g2, force.across + sensing.force_noise * g3),
    )
    store(w, ROW.readings.now, i, reading)


@device
def quantised(value: float, resolution: float) -> float:
    """Return the nearest multiple of a resolution, or the value where there is none."""
    return resolution * math.floor(value / resolution + 0.5) if resolution > 0.0 else value


@device
def observe_world(w: Any, i: int) -> None:
    """Find the present observation as ideal sensors see it, in SI units."""
    seen = observation(
        load(w, ROW.motion, i),
        situated(w, i),
        w[ROW.task.path.length, i],
        w[ROW.task.pace, i],
        load(w, ROW.command, i),
        load(w, ROW.torque, i),
        hand_force(w, i),
    )
    store(w, ROW.seen, i, seen)


@outlined
def observe_reading(w: Any, i: int, constants: Any) -> None:
    """Find the present observation from what the sensors read, now or earlier, in SI units."""
    reading = load(w, ROW.readings[int(w[ROW.task.sensing.delay, i])], i)
    link_a = unit_vector(reading.theta.a)
    link_b = unit_vector(reading.theta.b)
    q = Motion(
        reading.theta.a,
        reading.theta.b,
        reading.omega.a,
        reading.omega.b,
        link_a.cos,
        link_a.sin,
        link_b.cos,
        link_b.sin,
    )
    arm = load(w, ROW.machine.arm, i)
    path = load(w, ROW.task.path, i)
    x, y = tip_position(arm, q)
    v_x, v_y = tip_velocity(arm, q)
    foot = project(constants, int(path.first), int(path.arcs), int(w[ROW.foot.segment, i]), x, y)
    seen = observation(
        q,
        situation(foot, v_x, v_y),
        path.length,
        w[ROW.task.pace, i],
        load(w, ROW.command, i),
        reading.torque,
        reading.force,
    )
    store(w, ROW.seen, i, seen)


@device
def scale_entries(w: Any, first: int, last: int, config: Any) -> None:
    """Bring the observations in columns ``first`` … ``last`` − 1 from SI units to their scales, within ±BOUND."""
    for k in range(ENTRIES):
        inverse_scale = config[_FIRST_INVERSE_SCALE + k]
        for i in range(first, last):
            w[_FIRST_SEEN + k, i] = between(w[_FIRST_SEEN + k, i] * inverse_scale, -BOUND, BOUND)


@device
def write_observation(w: Any, i: int, obs: Any, world: int, config: Any, constants: Any) -> None:
    """Write what was observed, and what is told of the context, to a row of the observations (N, entries)."""
    plain = int(config[CONFIG.entries])
    for k in range(ENTRIES):  # not over the entries: compilers unroll what they can count
        if k < plain:
            obs[world, k] = w[_FIRST_SEEN + k, i]
    told = int(w[ROW.context_at, i]) + CONSTANT_ROWS - plain
    for k in range(plain, obs.shape[1]):
        obs[world, k] = between(constants[told + k] / config[CONFIG_WIDTH + k], -BOUND, BOUND)


@device
def see(w: Any, i: int, config: Any, constants: Any) -> None:
    """Find the present observation of a world with any sensors."""
    if w[ROW.task.sensing.is_ideal, i] != 0.0:
        observe_world(w, i)
    else:
        observe_reading(w, i, constants)
    scale_entries(w, i, i + 1, config)
