"""The arm with dry friction in continuous time: smooth phases integrated by DOP853, switched at
events.

In a phase it is settled which clutches slip, which way, and which slips are inside the Karnopp band
|w| < δω. The equations are then smooth, and an event ends the phase: a slip vanishes or reaches the
edge of the band, a stuck clutch is asked for more than its breakaway torque, or the load leaves
what the clutches can hold. Torques are decided first and accelerations follow, as in the paper;
nothing here is a velocity-level problem, and nothing is shared with the package.

    capacity of a clutch = T_s if it is stuck or inside the band, else T_k
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.integrate import solve_ivp

from oracle import friction

W = np.array(friction.W, float)
LINE = np.array(friction.LINE, float)
LINE_SLIPS = LINE @ W.T
"""LINE_SLIPS[x, y]: slip of clutch y for unit speed along the line of clutch x."""

TOLERANCE = {"rtol": 1e-11, "atol": 1e-12, "max_step": 0.01}
FIRST_STEP = 1e-7
"""Short, so a slip that leaves zero at the start of a phase is seen [s]."""


@dataclass(frozen=True)
class Plant:
    """An arm, the hand on its tip and the clutch torques as functions of time [s], in SI units."""

    lengths: tuple[float, float]
    inertia_a: float
    inertia_b: float
    coupling: float
    force: Callable[[float], np.ndarray]
    breakaway: Callable[[float], np.ndarray]
    dynamic: Callable[[float], np.ndarray]
    threshold: float
    mass: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    target: tuple[float, float] = (0.0, 0.0)
    viscous: tuple[float, float] = (0.0, 0.0)
    edge: float = 1.0
    """How far from zero the edge of the stick band counts as left, times the threshold."""

    def inertia(self, theta: np.ndarray) -> np.ndarray:
        l_a, l_b = self.lengths
        m12 = (self.coupling + self.mass * l_a * l_b) * math.cos(theta[0] - theta[1])
        return np.array(
            [[self.inertia_a + self.mass * l_a**2, m12], [m12, self.inertia_b + self.mass * l_b**2]]
        )

    def load(self, t: float, theta: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """Torque on the links of everything but the clutches and the inertia [N·m]."""
        l_a, l_b = self.lengths
        (a, b), (omega_a, omega_b) = theta.tolist(), omega.tolist()
        ax, ay, bx, by = l_a * math.cos(a), l_a * math.sin(a), l_b * math.cos(b), l_b * math.sin(b)
        x, y = self.force(t).tolist()
        x -= self.damping * (-ay * omega_a - by * omega_b) + self.stiffness * (
            ax + bx - self.target[0]
        )
        y -= self.damping * (ax * omega_a + bx * omega_b) + self.stiffness * (
            ay + by - self.target[1]
        )
        c_sin = (self.coupling + self.mass * l_a * l_b) * math.sin(a - b)
        free = np.array(
            [ax * y - ay * x - c_sin * omega_b**2, bx * y - by * x + c_sin * omega_a**2]
        )
        return free - np.multiply(self.viscous, omega)


AT_REST, SLIDING = "rest", "sector"


@dataclass(frozen=True)
class Phase:
    """What sticks (clutch 0 … 3, AT_REST or SLIDING), the direction of each slip (0: stuck), which
    are in the band."""

    stuck: int | str
    sign: tuple[float, ...]
    inside: tuple[bool, ...] = (True,) * 4

    @cached_property
    def held(self) -> np.ndarray:
        """Which clutches have their breakaway torque."""
        return np.array(self.inside) | (np.array(self.sign) == 0.0)


@dataclass(frozen=True)
class ExactMotion:
    """Angles and velocities on a time grid, and the phases that the arm went through."""

    theta: np.ndarray
    omega: np.ndarray
    phases: list[Phase]
    switched: list[float] = field(default_factory=list)


def capacities(plant: Plant, phase: Phase, t: float) -> np.ndarray:
    if phase.held.all():
        return plant.breakaway(t)
    return np.where(phase.held, plant.breakaway(t), plant.dynamic(t))


def _remaining(plant: Plant, phase: Phase, t: float, y: np.ndarray) -> np.ndarray:
    """Load less what the slipping clutches take."""
    return plant.load(t, y[:2], y[2:]) - W.T @ (capacities(plant, phase, t) * phase.sign)


def acceleration(plant: Plant, phase: Phase, t: float, y: np.ndarray) -> np.ndarray:
    if phase.stuck == AT_REST:
        return np.zeros(2)
    mass, left = plant.inertia(y[:2]), _remaining(plant, phase, t, y)
    if phase.stuck == SLIDING:
        (m_aa, m_ab), (_, m_bb) = mass.tolist()
        a, b = left.tolist()
        return np.array([m_bb * a - m_ab * b, m_aa * b - m_ab * a]) / (m_aa * m_bb - m_ab * m_ab)
    d = LINE[phase.stuck]
    return d * (d @ left) / (d @ mass @ d)


def demand(plant: Plant, phase: Phase, t: float, y: np.ndarray) -> float:
    """Torque that the stuck clutch must take for its slip to stay zero."""
    left = _remaining(plant, phase, t, y) - plant.inertia(y[:2]) @ acceleration(plant, phase, t, y)
    w = W[phase.stuck]
    return float(w @ left / (w @ w))


# --- events: every one falls through zero ---


def _events(plant: Plant, phase: Phase) -> list[tuple[tuple, Callable]]:
    """Names and functions of (t, y).

    Released clutches have none: their slips may vanish and nothing changes.
    """
    engaged = [x for x in range(4) if plant.breakaway(0.0)[x] + plant.breakaway(math.inf)[x] > 0.0]
    if phase.stuck == AT_REST:
        return [(("give way", x), _side_gap(plant, x)) for x in engaged]
    moving = [x for x in range(4) if phase.sign[x] != 0.0]
    if phase.stuck == SLIDING:
        moving = [x for x in moving if x in engaged]
        events = [(("stop", x), _slip_left(phase, x, 0.0)) for x in moving]
    else:
        events = [
            (("yield", phase.stuck), _yield_gap(plant, phase)),
            (("stop", 0), _slip_left(phase, moving[0], 0.0)),
        ]
    for x in moving:
        past = _slip_left(
            phase, x, plant.edge * plant.threshold if phase.inside[x] else plant.threshold
        )
        event = (lambda t, y, past=past: -past(t, y)) if phase.inside[x] else past
        events.append((("edge", x), event))
    return events


def _slip_left(phase: Phase, x: int, margin: float) -> Callable:
    return lambda _, y: phase.sign[x] * (W[x] @ y[2:]) - margin


def _yield_gap(plant: Plant, phase: Phase) -> Callable:
    return lambda t, y: plant.breakaway(t)[phase.stuck] - abs(demand(plant, phase, t, y))


def _side_gap(plant: Plant, x: int) -> Callable:
    return lambda t, y: (
        plant.breakaway(t) @ abs(LINE_SLIPS[x]) - abs(LINE[x] @ plant.load(t, y[:2], y[2:]))
    )


# --- what follows an event ---


def _after(
    plant: Plant, phase: Phase, event: tuple, t: float, y: np.ndarray
) -> tuple[Phase, np.ndarray]:
    kind, x = event
    if kind == "edge":
        # along a clutch's line several slips are equal and change together
        gap = np.abs(W @ y[2:]) - plant.threshold
        with_x = (np.array(phase.inside) == phase.inside[x]) & (
            np.abs(gap - gap[x]) <= 1e-9 * plant.threshold
        )
        return _if_it_holds(
            plant,
            replace(phase, inside=tuple(bool(i) for i in np.array(phase.inside) ^ with_x)),
            t,
            y,
        )
    if kind == "give way":
        return _along(x, float(np.sign(LINE[x] @ plant.load(t, y[:2], y[2:])))), y
    if kind == "yield":
        return _yielding(plant, phase, t, y), y
    if phase.stuck != SLIDING:
        return from_rest(plant, t, y[:2])
    return _caught(plant, phase, x, t, y)


def _yielding(plant: Plant, phase: Phase, t: float, y: np.ndarray) -> Phase:
    sign = list(phase.sign)
    sign[phase.stuck] = float(np.sign(demand(plant, phase, t, y)))
    return replace(phase, stuck=SLIDING, sign=tuple(sign))


def _if_it_holds(plant: Plant, phase: Phase, t: float, y: np.ndarray) -> tuple[Phase, np.ndarray]:
    """At the edge of the band a torque jumps, and with it what the stuck clutch must take."""
    if phase.stuck != SLIDING and abs(demand(plant, phase, t, y)) > plant.breakaway(t)[phase.stuck]:
        return _yielding(plant, phase, t, y), y
    return phase, y


def _along(x: int, sign: float) -> Phase:
    return Phase(x, tuple(float(s) for s in np.sign(sign * LINE_SLIPS[x])))


def _caught(
    plant: Plant, phase: Phase, x: int, t: float, y: np.ndarray
) -> tuple[Phase, np.ndarray]:
    """A slip vanished while the others go on: it sticks if its breakaway torque suffices, else it
    goes through zero."""
    d, inside = LINE[x], list(phase.inside)
    y = np.concatenate([y[:2], d * (d @ y[2:]) / (d @ d)])
    # those of released clutches, which have no events, too
    sign = [float(s) for s in np.sign(W @ y[2:])]
    sign[x], inside[x] = 0.0, True
    stuck = Phase(x, tuple(sign), tuple(inside))
    needed = demand(plant, stuck, t, y)
    if abs(needed) <= plant.breakaway(t)[x]:
        return stuck, y
    sign[x] = float(np.sign(needed))
    return Phase(SLIDING, tuple(sign), tuple(inside)), y


def from_rest(plant: Plant, t: float, theta: np.ndarray) -> tuple[Phase, np.ndarray]:
    """The phase that begins at rest: the acceleration that the breakaway torques leave, from the
    dual problem."""
    y = np.concatenate([theta, np.zeros(2)])
    mass, load = plant.inertia(theta), plant.load(t, theta, np.zeros(2))
    start, mode = friction.solve_exactly(
        mass[0, 0], mass[0, 1], mass[1, 1], *load, plant.breakaway(t)
    )
    if mode == friction.ZERO_DOF:
        return Phase(AT_REST, (0.0,) * 4), y
    sign = tuple(float(np.sign(friction.slip(x, start.omega))) for x in range(4))
    return Phase(mode - 1 if mode else SLIDING, sign), y


def start(plant: Plant, theta: np.ndarray, omega: np.ndarray) -> tuple[Phase, np.ndarray]:
    """The first phase, from rest or from a velocity at which no slip vanishes."""
    slip = W @ omega
    if not np.any(omega):
        return from_rest(plant, 0.0, theta)
    assert np.all(slip != 0.0)
    return Phase(
        SLIDING, tuple(np.sign(slip)), tuple(np.abs(slip) < plant.threshold)
    ), np.concatenate([theta, omega])


def integrate(plant: Plant, theta: np.ndarray, omega: np.ndarray, grid: np.ndarray) -> ExactMotion:
    """Angles and velocities at the times of the grid, which starts after zero."""
    phase, y = start(plant, np.asarray(theta, float), np.asarray(omega, float))
    t, phases, switched = 0.0, [phase], [0.0]
    out = np.empty((len(grid), 4))
    while t < grid[-1]:
        events = _events(plant, phase)
        for _, function in events:
            function.terminal, function.direction = True, -1.0
        run = solve_ivp(
            lambda t, y, phase=phase: np.concatenate([y[2:], acceleration(plant, phase, t, y)]),
            (t, grid[-1]),
            y,
            method="DOP853",
            events=[function for _, function in events],
            dense_output=True,
            first_step=min(FIRST_STEP, grid[-1] - t),
            **TOLERANCE,
        )
        reached = (grid > t) & (grid <= run.t[-1])
        if reached.any():
            out[reached] = run.sol(grid[reached]).T
        if run.status == 0:
            break
        fired = next(i for i, times in enumerate(run.t_events) if len(times))
        t, y = float(run.t_events[fired][0]), run.y_events[fired][0]
        phase, y = _after(plant, phase, events[fired][0], t, y)
        phases.append(phase)
        switched.append(t)
        assert len(phases) < 10_000, "the reference chatters"
    return ExactMotion(out[:, :2], out[:, 2:], phases, switched)
