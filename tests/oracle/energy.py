"""Energy of each substep, added up again from the trajectory: ΔK = W − D − N + R.

With λ the clutches' impulses (opposing slip), ω⁺ the velocity after the substep and Δω its change,

    W = h ω⁺ᵀ(JᵀF + τ)      F: force, spring and damper of the hand (the damper at the new velocity)
    D = Σ λ_x w_x⁺          N = ½ Δωᵀ M Δω          R = ½ ω⁺ᵀ(M(θ⁺) − M(θ))ω⁺ − h ω⁺ᵀV
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pter_gym._physics.open_loop import Trajectory
from pter_gym.params import Machine


@dataclass(frozen=True)
class Budget:
    """Per substep: kinetic energy before and after, the four terms [J], what the clutches must exert [N·m], (T, 2)."""

    before: np.ndarray
    after: np.ndarray
    hand_work: np.ndarray
    dissipated: np.ndarray
    numerical_loss: np.ndarray
    residual: np.ndarray
    clutch_load: np.ndarray


def inertia(machine: Machine, theta: np.ndarray) -> np.ndarray:
    """Mass matrices (T, 2, 2) of the arm with the hand's mass at its tip."""
    arm, mass = machine.arm, machine.hand.mass
    m12 = (arm.coupling + mass * arm.length_a * arm.length_b) * np.cos(theta[:, 0] - theta[:, 1])
    m11 = np.full_like(m12, arm.inertia_a + mass * arm.length_a**2)
    m22 = np.full_like(m12, arm.inertia_b + mass * arm.length_b**2)
    return np.stack([np.stack([m11, m12], -1), np.stack([m12, m22], -1)], -2)


def budget(machine: Machine, run: Trajectory, force, torque, target) -> Budget:
    """The terms of every substep from angles, velocities and generated torques; inputs (T, 2)."""
    theta = np.vstack([run.initial.theta, run.theta])
    omega = np.vstack([run.initial.omega, run.omega])
    mass, new, change = inertia(machine, theta), omega[1:], np.diff(omega, axis=0)
    h, arm, hand = machine.substep, machine.arm, machine.hand

    sin, cos = np.sin(theta[:-1]), np.cos(theta[:-1])
    lengths = np.array([arm.length_a, arm.length_b])
    jacobian = np.stack([-lengths * sin, lengths * cos], axis=1)
    tip = np.stack([cos @ lengths, sin @ lengths], axis=-1)
    tip_velocity = np.einsum("kij,kj->ki", jacobian, new)
    pull = force + hand.stiffness * (target - tip) - hand.damping * tip_velocity
    load = np.einsum("kij,ki->kj", jacobian, pull) + torque

    c_sin = (arm.coupling + hand.mass * arm.length_a * arm.length_b) * np.sin(theta[:-1, 0] - theta[:-1, 1])
    velocity_terms = c_sin[:, None] * np.stack([omega[:-1, 1] ** 2, -(omega[:-1, 0] ** 2)], axis=-1)
    energy = 0.5 * np.einsum("ki,kij,kj->k", omega, mass, omega)
    return Budget(
        before=energy[:-1],
        after=energy[1:],
        hand_work=h * np.sum(new * load, axis=1),
        dissipated=-h * run.power.sum(axis=1),
        numerical_loss=0.5 * np.einsum("ki,kij,kj->k", change, mass[:-1], change),
        residual=0.5 * np.einsum("ki,kij,kj->k", new, np.diff(mass, axis=0), new)
        - h * np.sum(new * velocity_terms, axis=1),
        clutch_load=np.einsum("kij,kj->ki", mass[:-1], change) / h + velocity_terms - load,
    )
