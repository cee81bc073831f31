"""Torque over voltage (paper section IV-B.1, Fig. 5): the curves, and a bench test that recovers them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.params import Machine
from pter_gym.tools.paper.experiments.pose import POSE, resolved
from pter_gym.tools.paper.experiments.setup import PAPER_MACHINES

Array = NDArray[np.float64]

MEASURED_FROM = 4.0
"""Lowest voltage of the paper's tests [V] (section IV-B.1)."""

BENCH_VOLTAGES = 6
RAMP_TIME = 0.5
"""When the ramp of the bench test reaches the holding torque [s]."""

_SAMPLES = 241


@dataclass(frozen=True)
class MaterialCurves:
    """Torques of clutch 1 with one friction material.

    Attributes
    ----------
    breakaway, dynamic
        Torque curves [N·m] at ``TorqueCurves.volts``.
    bench_breakaway, bench_dynamic
        Bench test: largest torque before the slip and mean torque during it [N·m], at ``TorqueCurves.bench_volts``.
    """

    breakaway: Array
    dynamic: Array
    bench_breakaway: Array
    bench_dynamic: Array


@dataclass(frozen=True)
class TorqueCurves:
    """Torque curves of several materials.

    Attributes
    ----------
    volts, bench_volts
        Voltages of the curves and of the bench tests [V].
    materials
        By the name of the machine.
    """

    volts: Array
    bench_volts: Array
    materials: dict[str, MaterialCurves]


def torque_curves(machines: Mapping[str, Machine] = PAPER_MACHINES) -> TorqueCurves:
    """Return the torque curves of clutch 1 and the results of a bench test.

    In the bench test, as in the paper's, the voltage is constant and a slowly rising torque acts on link A until the
    clutch slips, and a little longer. Link B is locked.

    Parameters
    ----------
    machines
        By name; they share the largest voltage.
    """
    top = min(machine.clutch.voltage_max for machine in machines.values())
    volts = np.linspace(0.0, top, _SAMPLES)
    bench = np.linspace(min(MEASURED_FROM, top), top, BENCH_VOLTAGES)
    return TorqueCurves(volts, bench, {name: _material(machine, volts, bench) for name, machine in machines.items()})


def _material(machine: Machine, volts: Array, bench: Array) -> MaterialCurves:
    measured = np.array([bench_test(machine, float(v)) for v in bench])
    return MaterialCurves(
        breakaway=np.array([machine.clutch.breakaway.torque(float(v)) for v in volts]),
        dynamic=np.array([machine.clutch.dynamic.torque(float(v)) for v in volts]),
        bench_breakaway=measured[:, 0],
        bench_dynamic=measured[:, 1],
    )


def bench_test(machine: Machine, volts: float) -> tuple[float, float]:
    """Return the breakaway and dynamic torque of clutch 1 [N·m] from a test at a constant voltage [V]."""
    machine = resolved(machine)
    held = max(machine.clutch.breakaway.torque(volts), machine.clutch.dynamic.torque(volts))
    applied = (volts, machine.clutch.voltage_max, 0.0, 0.0)
    ramp = held * machine.substep / RAMP_TIME * (np.arange(round(1.1 * RAMP_TIME / machine.substep)) + 0.5)
    torque = np.column_stack([ramp, np.zeros_like(ramp)])
    run = simulate(machine, initial_state(machine, POSE, volts=applied), applied, (0.0, 0.0), torque)
    generated = np.abs(run.torque[:, 0])
    first = int(np.flatnonzero(run.slip_velocity[:, 0])[0])
    slipping = np.abs(run.slip_velocity[first:-1, 0]) >= machine.slip_threshold
    return float(generated[: first + 1].max()), float(generated[first + 1 :][slipping].mean())
