"""Sensor readings after a control step, and the observation made of them."""

import math

import numpy as np

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.philox import uniform4
from pter_gym._compiled.records import Records, entrywise, load, store
from pter_gym._engine.hand import hand_force
from pter_gym._engine.world import CONFIG, CONFIG_WIDTH, ROW
from pter_gym._physics.arm import PerLink
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym.tasks.path_following._context import CONTEXT
from pter_gym.tasks.path_following._observation import (
    BOUND,
    ENTRIES,
    Measurement,
    Reading,
    measurement_of,
    observation,
)
from pter_gym.tasks.path_following._position import PathVector
from pter_gym.tasks.path_following._specification import MAX_DELAY

_NOISE_STREAM = np.uint64(0x4E4F495345)
_FIRST_SEEN = ROW.seen.cos_a
_FIRST_TOLD = CONTEXT.told.time_constant
_FIRST_INVERSE_SCALE = CONFIG.inverse_scale.cos_a


@inlined
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


@entrywise
@inlined
def quantised(value: float, resolution: float) -> float:
    """Return the nearest multiple of a resolution, or the value where there is none."""
    return resolution * math.floor(value / resolution + 0.5) if resolution > 0.0 else value


@entrywise
@inlined
def noisy(value: float, deviation: float, draw: float) -> float:
    """Return a value with noise of a standard deviation, from a standard normal draw."""
    return value + deviation * draw


@entrywise
@inlined
def coasted(theta: float, omega: float, time: float) -> float:
    """Return an angle a time ago at the present angular velocity."""
    return theta - omega * time


@entrywise
@inlined
def measured_velocity(
    theta: float, before: float, omega: float, period: float, differs: bool
) -> float:
    """Return what a velocity sensor reads, or the mean velocity between two angle readings."""
    return (theta - before) / period if differs else omega


@outlined
def take_first_readings(
    w: Records, i: int, seed: np.uint64, episode: np.uint64, period: float
) -> None:
    """Read the sensors where an episode begins, as if the arm had coasted there."""
    q, resolution = load(w, ROW.motion, i), w[ROW.task.sensing.angle_resolution, i]
    before = coasted(PerLink(q.theta_a, q.theta_b), PerLink(q.omega_a, q.omega_b), period)
    for _ in range(1 + MAX_DELAY):
        store(w, ROW.readings.now.theta, i, quantised(before, resolution))
        take_reading(w, i, seed, episode, period)


@outlined
def take_reading(w: Records, i: int, seed: np.uint64, episode: np.uint64, period: float) -> None:
    """Read the sensors of a world, and keep the readings before."""
    for age in range(MAX_DELAY, 0, -1):
        store(w, ROW.readings[age], i, load(w, ROW.readings[age - 1], i))
    step = int(w[ROW.step, i])
    sensing = load(w, ROW.task.sensing, i)
    q = load(w, ROW.motion, i)
    g0, g1, g2, g3 = gaussians(seed, episode, 2 * step)
    n0, n1, n2, n3 = gaussians(seed, episode, 2 * step + 1)
    theta = quantised(PerLink(q.theta_a, q.theta_b), sensing.angle_resolution)
    before, differs = load(w, ROW.readings.one_ago.theta, i), sensing.encoder_velocity != 0.0
    omega = measured_velocity(theta, before, PerLink(q.omega_a, q.omega_b), period, differs)
    reading = Reading(
        theta=theta,
        omega=noisy(omega, sensing.velocity_noise, PerLink(g0, g1)),
        torque=noisy(load(w, ROW.torque, i), sensing.torque_noise, PerClutch(n0, n1, n2, n3)),
        force=noisy(hand_force(w, i), sensing.force_noise, PathVector(g2, g3)),
    )
    store(w, ROW.readings.now, i, reading)


@inlined
def store_observation(w: Records, i: int, measured: Measurement) -> None:
    """Store the present observation that a measurement gives, in SI units."""
    seen = observation(
        measured,
        load(w, ROW.machine.arm, i),
        load(w, ROW.task.free, i),
        w[ROW.task.path.length, i],
        w[ROW.task.pace, i],
        load(w, ROW.command, i),
    )
    store(w, ROW.seen, i, seen)


@inlined
def observe_world(w: Records, i: int) -> None:
    """Find the present observation as ideal sensors see it."""
    store_observation(
        w,
        i,
        Measurement(
            load(w, ROW.motion, i), load(w, ROW.foot, i), load(w, ROW.torque, i), hand_force(w, i)
        ),
    )


@outlined
def observe_reading(w: Records, i: int, constants: Records) -> None:
    """Find the present observation from what the sensors read, now or earlier."""
    reading = load(w, ROW.readings[int(w[ROW.task.sensing.delay, i])], i)
    arm, path = load(w, ROW.machine.arm, i), load(w, ROW.task.path, i)
    segment = int(w[ROW.foot.segment, i])
    first, count = int(path.first), int(path.arcs)
    store_observation(w, i, measurement_of(reading, arm, constants, first, count, segment))


@inlined
def scale_entries(w: Records, first: int, last: int, config: Records) -> None:
    """Bring the observations in columns ``first`` … ``last`` − 1 to their scales, within ±BOUND.

    Each passes here once a control step, and once at a reset.
    """
    for k in range(ENTRIES):
        inverse_scale = config[_FIRST_INVERSE_SCALE + k]
        for i in range(first, last):
            w[_FIRST_SEEN + k, i] = clamp(w[_FIRST_SEEN + k, i] * inverse_scale, -BOUND, BOUND)


@inlined
def observe(w: Records, i: int, config: Records, constants: Records) -> None:
    """Find the present observation of a world with any sensors."""
    if w[ROW.task.sensing.is_ideal, i] != 0.0:
        observe_world(w, i)
    else:
        observe_reading(w, i, constants)
    scale_entries(w, i, i + 1, config)


@inlined
def write_observation(
    w: Records, i: int, obs: Records, world: int, config: Records, constants: Records
) -> None:
    """Write the observation, and the context if that is observed, to a row of ``obs``."""
    plain = int(config[CONFIG.entries])
    for k in range(ENTRIES):  # not over the entries: compilers unroll what they can count
        if k < plain:
            obs[world, k] = w[_FIRST_SEEN + k, i]
    told = int(w[ROW.context_at, i]) + _FIRST_TOLD - plain
    for k in range(plain, obs.shape[1]):
        obs[world, k] = clamp(constants[told + k] / config[CONFIG_WIDTH + k], -BOUND, BOUND)
