"""The event-driven reference for a machine of the package, and random inputs for both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oracle.event_driven import Plant
from pter_gym.params import Machine


@dataclass(frozen=True)
class VoltageStep:
    """A step of the voltages at t = 0 and a smooth hand force, from a pose at rest or in motion."""

    volts_before: np.ndarray
    volts: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    constant: np.ndarray
    waves: np.ndarray
    rates: np.ndarray
    phases: np.ndarray
    scale: float = 1.0

    def force(self, t) -> np.ndarray:
        """Force on the tip [N], shape (2,) or (T, 2)."""
        angle = 2.0 * np.pi * np.multiply.outer(t, self.rates) + self.phases
        return self.scale * (self.constant + np.sin(angle) @ self.waves)


def draw(seed: int) -> VoltageStep:
    """Each clutch is engaged half of the time, at 4 … 12 V; forces of the order of what the
    clutches can hold."""
    rng = np.random.default_rng([77, seed])
    engaged = rng.integers(0, 2, 4)
    return VoltageStep(
        volts_before=engaged * rng.uniform(4.0, 12.0, 4),
        volts=engaged * rng.uniform(4.0, 12.0, 4),
        theta=rng.uniform(-np.pi, np.pi, 2),
        omega=rng.normal(0.0, 1.0, 2) * (rng.random() < 0.6),
        constant=rng.normal(0.0, 8.0, 2),
        waves=rng.normal(0.0, 14.0, (3, 2)),
        rates=rng.uniform(0.3, 1.5, 3),
        phases=rng.uniform(0.0, 2.0 * np.pi, 3),
    )


def plant(machine: Machine, scenario: VoltageStep, target=(0.0, 0.0)) -> Plant:
    """The same machine for the reference: the lag is an exponential, dry friction a part of
    clutches 1 and 2."""
    return Plant(
        lengths=(machine.arm.length_a, machine.arm.length_b),
        inertia_a=machine.arm.inertia_a,
        inertia_b=machine.arm.inertia_b,
        coupling=machine.arm.coupling,
        force=scenario.force,
        breakaway=_lagged(machine, machine.clutch.breakaway, scenario),
        dynamic=_lagged(machine, machine.clutch.dynamic, scenario),
        threshold=machine.slip_threshold,
        mass=machine.hand.mass,
        damping=machine.hand.damping,
        stiffness=machine.hand.stiffness,
        target=target,
        viscous=(machine.arm.viscous_a, machine.arm.viscous_b),
    )


def _lagged(machine: Machine, curve, scenario: VoltageStep):
    before = np.array([curve.torque(v) for v in scenario.volts_before])
    after = np.array([curve.torque(v) for v in scenario.volts])
    dry = np.array([machine.arm.dry_a, machine.arm.dry_b, 0.0, 0.0])
    return lambda t: dry + after + (before - after) * np.exp(-t / machine.clutch.time_constant)
