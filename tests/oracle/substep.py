"""Each substep of a trajectory again, from the row before it: half a drift, a kick with friction,
half a drift.

Written for all substeps at once, with friction from the dual problem in extended precision. Angles,
voltages and torques of the middle follow in closed form from the row before. With M, J and V of the
middle, b the hand's damping of which a share s acts by the velocity ω⁺ after, and λ the clutches'
impulses, a kick over a time h is

    (M + h·s·b·JᵀJ)·ω⁺ = M·ω + h·(JᵀF + τ − (1 − s)·b·JᵀJ·ω − V(ω)) + Wᵀλ

and is taken in parts where a clutch changes between sticking and slipping. Its energies are

    hand_work = h·ω⁺ᵀ(load − b·JᵀJ·(s·ω⁺ + (1 − s)·ω))
    dissipated = −λᵀWω⁺    numerical_loss = ½·ΔωᵀMΔω

and the residual is −h·ω⁺ᵀV, with ½·ωᵀδM·ω of the two drifts.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, fields

import numpy as np

from oracle import friction
from pter_gym._physics.open_loop import Trajectory
from pter_gym.params import Machine

W = np.array(friction.W, float)
MAX_PARTS = 4
MIN_PART = 1e-6
BEYOND = 1.01
"""How far from zero the edge of the band counts as left, times δω."""


@dataclass
class Substeps:
    """What T substeps lead to.

    Attributes
    ----------
    theta, omega
        Angles and angular velocities at the end, (T, 2).
    before, after, hand_work, dissipated, numerical_loss, residual
        Kinetic energy before and after, and the energy terms [J], (T,).
    clutch_load
        What the clutches exert on the links over the last part of the kick [N·m], (T, 2).
    limit
        Torque limits in that part [N·m], (T, 4).
    parts, span
        How many parts the kick has, and the time of its last one [s], (T,).
    momentum, condition
        All that enters the sums of the kick's momentum, and at most the condition of its mass
        matrix, (T,).
    """

    theta: np.ndarray
    omega: np.ndarray
    before: np.ndarray
    after: np.ndarray
    hand_work: np.ndarray
    dissipated: np.ndarray
    numerical_loss: np.ndarray
    residual: np.ndarray
    clutch_load: np.ndarray
    limit: np.ndarray
    parts: np.ndarray
    span: np.ndarray
    momentum: np.ndarray
    condition: np.ndarray


def inertia(machine: Machine, theta: np.ndarray) -> np.ndarray:
    """Mass matrices (T, 2, 2) of the arm with the hand's mass at its tip."""
    arm, mass = machine.arm, machine.hand.mass
    m12 = (arm.coupling + mass * arm.length_a * arm.length_b) * np.cos(theta[:, 0] - theta[:, 1])
    m11 = np.full_like(m12, arm.inertia_a + mass * arm.length_a**2)
    m22 = np.full_like(m12, arm.inertia_b + mass * arm.length_b**2)
    return np.stack([np.stack([m11, m12], -1), np.stack([m12, m22], -1)], -2)


def kinetic(mass: np.ndarray, omega: np.ndarray) -> np.ndarray:
    return 0.5 * np.einsum("ki,kij,kj->k", omega, mass, omega)


def torques_of_the_middle(
    machine: Machine, run: Trajectory, volts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Breakaway and dynamic torques [N·m] half a substep after each row, (T, 4): an exact
    first-order lag."""
    clutch, scale = machine.clutch, np.array(machine.clutch_scale)
    left = np.exp(-machine.substep / clutch.time_constant)
    if clutch.lag == "voltage":
        lagged, middle = run.initial.lagged_volts, []
        for command in volts:
            middle.append(command + np.sqrt(left) * (lagged - command))
            lagged = command + left * (lagged - command)
        return tuple(
            scale * np.vectorize(c.torque)(middle) for c in (clutch.breakaway, clutch.dynamic)
        )
    found = []
    for name in ("breakaway", "dynamic"):
        steady = scale * np.vectorize(getattr(clutch, name).torque)(volts)
        start = np.vstack(
            [getattr(run.initial, f"torque_{name}"), getattr(run, f"torque_{name}")[:-1]]
        )
        found.append(steady + np.sqrt(left) * (start - steady))
    return tuple(found)


def implicit_share(machine: Machine) -> float:
    arm = machine.arm
    smallest = np.linalg.eigvalsh([[arm.inertia_a, arm.coupling], [arm.coupling, arm.inertia_b]])[0]
    taken = machine.substep * machine.hand.damping * (arm.length_a**2 + arm.length_b**2)
    return max(0.5, 1.0 - smallest / taken) if taken > 0.0 else 0.5


class _Kick:
    """The kicks of all substeps: what is the same in each of their parts."""

    def __init__(self, machine: Machine, theta: np.ndarray, torques, force, torque, target) -> None:
        arm, hand = machine.arm, machine.hand
        sin, cos = np.sin(theta), np.cos(theta)
        lengths = np.array([arm.length_a, arm.length_b])
        jacobian = np.stack([-lengths * sin, lengths * cos], axis=1)
        tip = np.stack([cos @ lengths, sin @ lengths], axis=-1)
        pull = force + hand.stiffness * (target - tip)
        self.load = np.einsum("kij,ki->kj", jacobian, pull) + torque
        reach = np.abs(target) + lengths.sum()
        self.sizes = lengths.sum() * (np.abs(force) + hand.stiffness * reach).sum(axis=1) + np.abs(
            torque
        ).sum(axis=1)
        self.damping = hand.damping * np.einsum("kij,kil->kjl", jacobian, jacobian)
        self.implicit = implicit_share(machine)
        self.mass = inertia(machine, theta)
        c = arm.coupling + hand.mass * arm.length_a * arm.length_b
        self.c_sin = c * np.sin(theta[:, 0] - theta[:, 1])[:, None]
        self.breakaway, self.dynamic = torques
        self.threshold = machine.slip_threshold

    def velocity_term(self, omega: np.ndarray) -> np.ndarray:
        return self.c_sin * np.stack([omega[:, 1] ** 2, -(omega[:, 0] ** 2)], axis=-1)

    def limits(self, omega: np.ndarray) -> np.ndarray:
        inside = np.abs(omega @ W.T) < self.threshold
        return np.where(inside, np.maximum(self.breakaway, self.dynamic), self.dynamic)

    def problem(
        self, omega: np.ndarray, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Effective mass, momentum, and the hand's torque less its implicit damping."""
        explicit = (1.0 - self.implicit) * np.einsum("kij,kj->ki", self.damping, omega)
        hand = self.load - explicit
        effective = self.mass + h[:, None, None] * self.implicit * self.damping
        momentum = np.einsum("kij,kj->ki", self.mass, omega)
        return effective, momentum + h[:, None] * (hand - self.velocity_term(omega)), hand

    def momentum(self, omega: np.ndarray, h: float) -> np.ndarray:
        """The sizes of all that enters the sums of the momentum, (T,)."""
        speed = np.abs(omega).sum(axis=1)
        inertia = np.abs(self.mass).sum(axis=(1, 2)) + h * np.abs(self.damping).sum(axis=(1, 2))
        torque = self.sizes + np.abs(self.velocity_term(omega)).sum(axis=1)
        return inertia * speed + h * (torque + np.maximum(self.breakaway, self.dynamic).sum(axis=1))

    def after(self, omega: np.ndarray, h: np.ndarray) -> np.ndarray:
        effective, momentum, _ = self.problem(omega, h)
        return solve(effective, momentum, h[:, None] * self.limits(omega))

    def share_before_change(self, omega: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Share of a kick after which the first clutch changes, 1 for none."""
        before, after, limit = omega @ W.T, self.after(omega, h) @ W.T, self.limits(omega)
        outside = np.abs(before) >= self.threshold
        passes = outside & (before * after <= 0.0)
        leaves = ~outside & (np.abs(after) >= self.threshold) & (self.breakaway > self.dynamic)
        slid = after.copy()
        rows = np.flatnonzero(passes.any(axis=1))
        if rows.size:
            slid[rows] = self.slid(omega, h, passes, limit, rows)
        passes &= before * slid < 0.0
        leaves &= np.abs(slid) > BEYOND * self.threshold
        to = np.where(leaves, np.copysign(BEYOND * self.threshold, slid), 0.0)
        changes = passes | leaves
        return np.where(changes, (to - before) / np.where(changes, slid - before, 1.0), 1.0).min(
            axis=1
        )

    def slid(self, omega, h, passes, limit, rows) -> np.ndarray:
        """Slips after a kick in which those that pass zero never cease to slide."""
        before, passes = (omega @ W.T)[rows], passes[rows]
        effective, momentum, _ = self.at(rows).problem(omega[rows], h[rows])
        impulse = h[rows, None] * limit[rows]
        sliding = momentum - (np.sign(before) * passes * impulse) @ W
        return solve(effective, sliding, np.where(passes, 0.0, impulse)) @ W.T

    def at(self, rows: np.ndarray) -> _Kick:
        """The kicks of some substeps."""
        some = copy.copy(self)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                setattr(some, name, value[rows])
        return some


def solve(mass: np.ndarray, momentum: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    answer = friction.solve(
        mass[:, 0, 0], mass[:, 0, 1], mass[:, 1, 1], momentum[:, 0], momentum[:, 1], impulse
    )
    return np.stack(answer.omega, axis=-1).astype(float)


def again(machine: Machine, run: Trajectory, volts, force, torque, target) -> Substeps:
    """Every substep from the row before it; inputs (T, 4) and (T, 2)."""
    h = machine.substep
    theta = np.vstack([run.initial.theta, run.theta[:-1]])
    omega = np.vstack([run.initial.omega, run.omega[:-1]])
    middle = theta + 0.5 * h * omega
    kick = _Kick(machine, middle, torques_of_the_middle(machine, run, volts), force, torque, target)
    mass = inertia(machine, theta)
    found = _empty(len(theta))
    found.before = kinetic(mass, omega)
    found.residual += kinetic(kick.mass, omega) - found.before
    eigenvalues = np.linalg.eigvalsh(kick.mass + h * kick.damping)
    found.condition = eigenvalues[:, 1] / np.linalg.eigvalsh(kick.mass)[:, 0]
    found.momentum = kick.momentum(omega, h)
    rows, left = np.arange(len(theta)), np.full(len(theta), h)
    for number in range(MAX_PARTS):
        some = kick.at(rows)
        share = some.share_before_change(omega[rows], left)
        last = (number == MAX_PARTS - 1) | ~(share < 1.0 - MIN_PART)
        span = np.where(last, left, share * left)
        omega[rows] = _take(found, rows, some, omega[rows], span)
        rows, left = rows[~last], (left - span)[~last]
    found.omega, found.theta = omega, middle + 0.5 * h * omega
    found.after = kinetic(inertia(machine, found.theta), omega)
    found.residual += found.after - kinetic(kick.mass, omega)
    return found


def _take(
    found: Substeps, rows: np.ndarray, kick: _Kick, omega: np.ndarray, h: np.ndarray
) -> np.ndarray:
    """Take parts of a time h of some kicks, and add their energies up."""
    new = kick.after(omega, h)
    change = new - omega
    _, _, hand = kick.problem(omega, h)
    hand = hand - kick.implicit * np.einsum("kij,kj->ki", kick.damping, new)
    velocity_term = kick.velocity_term(omega)
    found.hand_work[rows] += h * np.sum(new * hand, axis=1)
    found.dissipated[rows] += h * np.sum(np.abs(new @ W.T) * kick.limits(omega), axis=1)
    found.numerical_loss[rows] += kinetic(kick.mass, change)
    found.residual[rows] -= h * np.sum(new * velocity_term, axis=1)
    found.clutch_load[rows] = (
        np.einsum("kij,kj->ki", kick.mass, change) / h[:, None] - hand + velocity_term
    )
    found.limit[rows] = kick.limits(omega)
    found.span[rows] = h
    found.parts[rows] += 1
    return new


def _empty(steps: int) -> Substeps:
    widths = {"theta": (2,), "omega": (2,), "clutch_load": (2,), "limit": (4,)}
    return Substeps(
        **{field.name: np.zeros((steps, *widths.get(field.name, ()))) for field in fields(Substeps)}
    )
