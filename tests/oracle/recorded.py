"""Logs of machines that the package's model may not know, from an integrator of its own.

Clutches and bearings are stiff springs with a damper that give way: a spring that is asked for more
than the breakaway torque slips, with a torque that may depend on the slip, until the slip turns
round. Steps of 20 µs; nothing is shared with the package but the format of a log. Links may be
flexible: the clutches and encoders are on the axes, which have a share of the inertia, and the hand
is on the links, with a torsion spring between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from pter_gym.tools.identification import Log

STEP = 2e-5
SPRING, DAMPER = 4e5, 900.0
"""Of a friction contact that holds [N·m/rad, N·m·s/rad]: 20 N·m bend it by 50 µrad, and with 0.5
kg·m² it settles within a few milliseconds without overshooting, which would break it away too
early."""

AXIS_SHARE = 0.4
"""Of the inertia, on the axis' side of a flexible link."""

HAND = (800.0, 30.0)
"""Stiffness and damping of the person's hand [N/m, N·s/m]."""


@dataclass(frozen=True)
class RecordedMachine:
    """A machine: lengths, inertias, coupling, slope of T_k, T_s/T_k, lag, and what the package's
    model may not have.

    Attributes
    ----------
    growth
        Of T_k per slip [s/rad].
    stribeck
        Slip velocity [rad/s] over which T_s falls to T_k: exponentially, or with the square of the
        speed if ``rational``.
    link
        Stiffness of the links [N·m/rad], 0 for rigid ones.
    off_state, drag
        Of each clutch: torque without voltage [N·m], and viscous torque [N·m·s].
    fall_ratio
        Time constant of a falling torque over that of a rising one.
    ratios
        T_s/T_k of each clutch over ``ratio``.
    fade, cooling
        Torque lost per heat of a clutch [1/J], and the time constant with which it cools [s].
    asymmetry
        Relative excess of the torque at a positive slip, and lack of it at a negative one.
    hysteresis
        Width of the loop of each clutch's voltage [V].
    remanence
        Share of a clutch's highest torque so far that stays without voltage.
    play
        Slip by which the gear of the fourth clutch moves freely [rad].
    """

    lengths: tuple[float, float] = (0.5645, 0.4454)
    inertias: tuple[float, float] = (0.5, 0.8)
    coupling: float = 0.05
    slope: float = 0.9
    ratio: float = 1.22
    time_constant: float = 0.08
    dry: tuple[float, float] = (0.0, 0.0)
    viscous: tuple[float, float] = (0.0, 0.0)
    growth: float = 0.0
    stribeck: float = 0.0
    link: float = 0.0
    rational: bool = False
    off_state: float = 0.0
    drag: float = 0.0
    fall_ratio: float = 1.0
    ratios: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    fade: float = 0.0
    cooling: float = 60.0
    asymmetry: float = 0.0
    hysteresis: float = 0.0
    remanence: float = 0.0
    play: float = 0.0


def record(
    machine: RecordedMachine,
    levels: tuple[float, ...] = (8.0, 16.0, 4.0, 12.0),
    seed: int = 0,
    interval: float = 2e-3,
) -> Log:
    """The log of the experiment of docs/identify.md, 14-bit encoders and 0.3 N of noise."""
    rng = np.random.default_rng([seed, 9])
    free, on, off = 4.0, 0.9, 0.25
    rows = round((free + 4 * len(levels) * (on + off)) / interval)
    times = interval * np.arange(rows)
    place = np.floor((times + 0.5 * interval - free) / (on + off)).astype(int)
    volts = np.zeros((rows, 4))
    engaged = (place >= 0) & (times + 0.5 * interval - free - place * (on + off) < on)
    volts[engaged, place[engaged] % 4] = np.array(levels)[place[engaged] // 4]
    numbers = np.array(
        [
            *(*machine.lengths, *machine.inertias, machine.coupling, machine.slope, machine.ratio),
            *(
                machine.time_constant,
                *machine.dry,
                *machine.viscous,
                machine.growth,
                machine.stribeck,
                machine.link,
            ),
            *(
                machine.rational,
                machine.off_state,
                machine.drag,
                machine.fall_ratio,
                machine.fade,
                machine.cooling,
            ),
            *(machine.asymmetry, machine.remanence, machine.play),
        ]
    )
    phases = rng.uniform(0.0, 2.0 * math.pi, 2)
    effective = _looped(volts, 0.5 * machine.hysteresis)
    theta, force = _run(
        numbers, np.array(machine.ratios), effective, phases, round(interval / STEP)
    )
    step = 2.0 * math.pi / 16384
    return Log(
        interval=interval,
        volts=volts,
        theta=step * np.round(theta / step),
        force=force + 0.3 * rng.standard_normal((rows, 2)),
        name="recorded",
    )


def _looped(volts: np.ndarray, half: float) -> np.ndarray:
    """Voltages behind a play of a half width [V]."""
    found = volts.copy()
    for k in range(1, len(volts)):
        found[k] = found[k - 1].clip(volts[k] - half, volts[k] + half)
    return found


@numba.njit
def _slid(slip, held, ratio, growth, stribeck, rational):
    """Torque of a sliding contact over T_k at no slip."""
    speed = abs(slip)
    extra = 0.0
    if stribeck > 0.0:
        extra = (
            1.0 / (1.0 + (speed / stribeck) ** 2) if rational > 0.0 else math.exp(-speed / stribeck)
        )
    return held * (1.0 + growth * speed + (ratio - 1.0) * extra)


@numba.njit
def _contact(i, slip, held, most, bent, way, play):
    """Torque against the slip of a contact; ``bent`` is its spring with its play, ``way`` the
    direction of its slip, 0 if held."""
    if way[i] != 0.0 and slip * way[i] <= 0.0:
        way[i], bent[i] = 0.0, way[i] * (held / SPRING + 0.5 * play)
    if way[i] != 0.0:
        return way[i] * held
    bent[i] += STEP * slip
    beyond = max(abs(bent[i]) - 0.5 * play, 0.0)
    if beyond == 0.0 and play > 0.0:
        return 0.0
    pulled = SPRING * beyond * np.sign(bent[i]) + DAMPER * slip
    if abs(pulled) > most:
        way[i] = 1.0 if pulled > 0.0 else -1.0
    return pulled


@numba.njit
def _hand(numbers, t, arm, speed, phases, middle):
    """Force of the hand on the tip."""
    l_a, l_b = numbers[0], numbers[1]
    ramp = 0.12 * min(t, 1.0)
    x = l_a * math.cos(arm[0]) + l_b * math.cos(arm[1])
    y = l_a * math.sin(arm[0]) + l_b * math.sin(arm[1])
    v_x = -l_a * math.sin(arm[0]) * speed[0] - l_b * math.sin(arm[1]) * speed[1]
    v_y = l_a * math.cos(arm[0]) * speed[0] + l_b * math.cos(arm[1]) * speed[1]
    to_x = middle[0] + ramp * math.sin(2.0 * math.pi * 0.83 * t + phases[0])
    to_y = middle[1] + ramp * math.sin(2.0 * math.pi * 1.27 * t + phases[1])
    return HAND[0] * (to_x - x) - HAND[1] * v_x, HAND[0] * (to_y - y) - HAND[1] * v_y


@numba.njit(cache=True)
def _run(numbers, ratios, volts, phases, per_row):
    (
        l_a,
        l_b,
        m_a,
        m_b,
        c,
        slope,
        ratio,
        tau,
        dry_a,
        dry_b,
        visc_a,
        visc_b,
        growth,
        stribeck,
        link,
    ) = numbers[:15]
    rational, off_state, drag, fall_ratio, fade, cooling, asymmetry, remanence, play = numbers[15:]
    rows = len(volts)
    theta, force = np.empty((rows, 2)), np.empty((rows, 2))
    axis = np.array([0.5 * math.pi - 0.85, 0.5 * math.pi + 0.6])
    arm, axis_speed, arm_speed = axis.copy(), np.zeros(2), np.zeros(2)
    middle = (
        l_a * math.cos(axis[0]) + l_b * math.cos(axis[1]),
        l_a * math.sin(axis[0]) + l_b * math.sin(axis[1]),
    )
    weight = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    limit, bent, way = np.zeros(6), np.zeros(6), np.zeros(6)
    limit[4], limit[5] = dry_a, dry_b
    limit[:4] = off_state
    heat, highest = np.zeros(4), np.zeros(4)
    rise, fall, cooler = (
        math.exp(-STEP / tau),
        math.exp(-STEP / (tau * fall_ratio)),
        math.exp(-STEP / cooling),
    )
    inertia, viscous = np.array([m_a, m_b]), np.array([visc_a, visc_b])
    own = (1.0 - AXIS_SHARE) * inertia if link > 0.0 else inertia
    for k in range(rows * per_row):
        row = k // per_row
        f_x, f_y = _hand(numbers, k * STEP, arm, arm_speed, phases, middle)
        if k % per_row == 0:
            theta[row] = axis
            force[row, 0], force[row, 1] = f_x, f_y
        on_axis = -viscous * axis_speed
        for i in range(6):
            slip = weight[i, 0] * axis_speed[0] + weight[i, 1] * axis_speed[1]
            if i < 4:
                highest[i] = max(highest[i], limit[i])
                ahead = limit[i] - max(slope * volts[row, i] + off_state, remanence * highest[i])
                limit[i] += ahead * ((fall if ahead > 0.0 else rise) - 1.0)
                side = slip if way[i] != 0.0 else bent[i]
                most = limit[i] * (1.0 + asymmetry * np.sign(side)) / (1.0 + fade * heat[i])
                held = _slid(
                    slip, most, ratio * ratios[i], growth, stribeck, rational
                ) + drag * abs(slip)
                torque = _contact(
                    i, slip, held, most * ratio * ratios[i], bent, way, play * (i == 3)
                )
                heat[i] = (heat[i] + STEP * abs(torque * slip)) * cooler
            else:
                torque = _contact(i, slip, limit[i], limit[i], bent, way, 0.0)
            on_axis -= weight[i] * torque
        sin = c * math.sin(arm[0] - arm[1])
        on_a = l_a * (math.cos(arm[0]) * f_y - math.sin(arm[0]) * f_x) - sin * arm_speed[1] ** 2
        on_b = l_b * (math.cos(arm[1]) * f_y - math.sin(arm[1]) * f_x) + sin * arm_speed[0] ** 2
        passed = on_axis
        if link > 0.0:
            passed = link * (axis - arm) + 0.002 * link * (axis_speed - arm_speed)
            axis_speed += STEP * (on_axis - passed) / (AXIS_SHARE * inertia)
            axis += STEP * axis_speed
        on_a += passed[0]
        on_b += passed[1]
        m12 = c * math.cos(arm[0] - arm[1])
        det = own[0] * own[1] - m12 * m12
        arm_speed[0] += STEP * (own[1] * on_a - m12 * on_b) / det
        arm_speed[1] += STEP * (own[0] * on_b - m12 * on_a) / det
        arm += STEP * arm_speed
        if link == 0.0:
            axis[:], axis_speed[:] = arm, arm_speed
    return theta, force
