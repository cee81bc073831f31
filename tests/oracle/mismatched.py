"""Logs of machines and sensors that differ from the package's assumptions, one or several at a
time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import signal

from oracle.experiment import Experiment, record_log
from oracle.recorded import RecordedMachine, record
from pter_gym.params import BASELINE, Machine, TorqueCurve
from pter_gym.tools.identification import Log, quantities

SLOW = 2.0**0.5 / (2.0 * np.pi * 20.0)
"""Delay of slow signals behind the filter of second order at 20 Hz [s]."""

HEAT = 60.0
"""What a clutch takes up in such a log, at most [J]."""

Sensors = Callable[[Log], Log]

SHORT = Experiment(levels=(8.0, 16.0, 4.0, 12.0), on=0.9, off=0.25, free=4.0)


def as_they_are(log: Log) -> Log:
    return log


def machine_of(
    dry: tuple[float, float] = (0.0, 0.0), off_state: float = 0.0, **clutch: float
) -> Machine:
    """The machine of ``Recorded()`` as the package has it, with other fields of its clutches."""
    dynamic = TorqueCurve(slope=0.9, knee=24.0, curvature=0.0, off_state=off_state)
    arm = replace(
        BASELINE.arm, inertia_a=0.5, inertia_b=0.8, coupling=0.05, dry_a=dry[0], dry_b=dry[1]
    )
    own = {"time_constant": 0.08, **clutch}
    clutches = replace(BASELINE.clutch, dynamic=dynamic, breakaway=dynamic.scaled(1.22), **own)
    return replace(BASELINE, arm=arm, clutch=clutches)


@dataclass(frozen=True)
class Mismatch:
    """A machine of the package's kind or of the oracle's, and what sensors make of its log.

    ``gain`` is that of the force sensor; ``slack`` is a relative error that no log shows: that of a
    sensor's scale, or of clutches that are warm. ``late`` are delays [s] of the motion behind the
    voltages, and of the forces behind the angles."""

    machine: RecordedMachine | Machine = field(default_factory=machine_of)
    sensors: Sensors = as_they_are
    gain: float = 1.0
    slack: float = 0.0
    biased: bool = False
    late: tuple[float, float] = (0.0, 0.0)

    def log(self) -> Log:
        machine = self.machine
        return self.sensors(
            record_log(machine, SHORT) if isinstance(machine, Machine) else record(machine)
        )

    def true_values(self, top: float) -> dict[str, float]:
        """Numbers by name as a log up to a voltage [V] shows them.

        They are proportional to the gain, and the clutches' drag is the axes' own. Constant torques
        are not among them where the force sensor's zero makes some.
        """
        machine = self.machine
        like = (
            machine_of(machine.dry, machine.off_state)
            if isinstance(machine, RecordedMachine)
            else machine
        )
        arm, clutch = like.arm, like.clutch
        drag = 3.0 * clutch.viscous  # Σ v·W_x² of the paper's four
        arm = replace(arm, viscous_a=arm.viscous_a + drag, viscous_b=arm.viscous_b + drag)
        told = quantities(replace(like, arm=arm), self.late[0], top, force_delay=self.late[1])
        told = [each for each in told if not (self.biased and each.name.startswith("offset"))]
        forces = {"kg·m²", "N·m", "N·m/V", "N·m/V²", "N·m·s"}
        return {
            each.name: each.value * (self.gain if each.unit in forces else 1.0) for each in told
        }


def bent(size: float) -> Sensors:
    """Encoders with eccentric discs: errors of a size [rad] over a turn."""
    return lambda log: replace(
        log, theta=log.theta + size * np.sin(log.theta + np.array([0.4, 1.9]))
    )


def late(time: float) -> Sensors:
    """Forces recorded a time [s] after the angles."""

    def shifted(log: Log) -> Log:
        when = log.times - time
        return replace(
            log, force=np.column_stack([np.interp(when, log.times, each) for each in log.force.T])
        )

    return shifted


def filtered(name: str, cutoff: float) -> Sensors:
    """A sensor behind a low-pass filter of second order with a cutoff frequency [Hz]."""

    def low_passed(log: Log) -> Log:
        low = signal.butter(2, 2.0 * cutoff * log.interval)
        values = getattr(log, name)
        start = signal.lfilter_zi(*low)[:, None] * values[:1]
        return replace(log, **{name: signal.lfilter(*low, values, axis=0, zi=start)[0]})

    return low_passed


def biased(x: float, y: float) -> Sensors:
    """A force sensor that was not zeroed [N]."""
    return lambda log: replace(log, force=log.force + np.array([x, y]))


def gained(x: float, y: float) -> Sensors:
    """A force sensor with other gains."""
    return lambda log: replace(log, force=log.force * [x, y])


IN_THE_MODEL = {
    "as assumed": Mismatch(),
    "dry friction of the axes": Mismatch(machine_of(dry=(0.4, 0.3))),
    **{
        f"Stribeck {v:g} rad/s": Mismatch(machine_of(stribeck=v))
        for v in (0.03, 0.05, 0.1, 0.2, 0.3)
    },
    **{f"off-state torque {t:g} N·m": Mismatch(machine_of(off_state=t)) for t in (0.1, 0.5)},
    **{f"drag {v:g} N·m·s": Mismatch(machine_of(viscous=v)) for v in (0.05, 0.2)},
    **{f"fall ratio {r:g}": Mismatch(machine_of(fall_ratio=r)) for r in (0.5, 1.5, 3.0)},
    "Stribeck, off-state torque and fall": Mismatch(
        machine_of(stribeck=0.1, off_state=0.2, fall_ratio=2.0)
    ),
    "a magnetorheological brake": Mismatch(
        machine_of(off_state=0.3, viscous=0.05, time_constant=0.02)
    ),
}

NOT_IN_THE_MODEL = {
    "exponential Stribeck 0.05": Mismatch(RecordedMachine(stribeck=0.05)),
    "exponential Stribeck 0.15": Mismatch(RecordedMachine(stribeck=0.15)),
    "exponential Stribeck 0.3": Mismatch(RecordedMachine(stribeck=0.3)),
    "T_s/T_k of clutch 1 +10 %": Mismatch(RecordedMachine(ratios=(1.1, 1.0, 1.0, 1.0))),
    "T_s/T_k of clutch 2 −10 %": Mismatch(RecordedMachine(ratios=(1.0, 0.9, 1.0, 1.0))),
    "T_s/T_k of clutch 3 +10 %": Mismatch(RecordedMachine(ratios=(1.0, 1.0, 1.1, 1.0))),
    "T_s/T_k of clutch 4 −10 %": Mismatch(RecordedMachine(ratios=(1.0, 1.0, 1.0, 0.9))),
    **{
        f"fade {100.0 * f:g} %/J": Mismatch(machine_of(fade=f), slack=HEAT * f)
        for f in (2e-4, 5e-4, 1e-3, 2e-3)
    },
    "hysteresis 0.2 V": Mismatch(RecordedMachine(hysteresis=0.2)),
    "hysteresis 1 V": Mismatch(RecordedMachine(hysteresis=1.0)),
    "asymmetry 2 %": Mismatch(RecordedMachine(asymmetry=0.02)),
    "asymmetry 10 %": Mismatch(RecordedMachine(asymmetry=0.1)),
    "torque that grows with the slip": Mismatch(RecordedMachine(growth=0.15)),
    "flexible links": Mismatch(RecordedMachine(link=5000.0)),
}

SENSORS = {
    "angles bent by 1 mrad": Mismatch(sensors=bent(1e-3), slack=3e-3),
    "angles bent by 10 mrad": Mismatch(sensors=bent(1e-2), slack=3e-2),
    "forces 2 ms late": Mismatch(sensors=late(2e-3), late=(0.0, 2e-3)),
    "forces 5 ms late": Mismatch(sensors=late(5e-3), late=(0.0, 5e-3)),
    "forces 5 ms early": Mismatch(sensors=late(-5e-3), late=(0.0, -5e-3)),
    "forces filtered at 20 Hz": Mismatch(sensors=filtered("force", 20.0), late=(0.0, SLOW)),
    "forces filtered at 60 Hz": Mismatch(sensors=filtered("force", 60.0), late=(0.0, SLOW / 3.0)),
    "angles filtered at 20 Hz": Mismatch(sensors=filtered("theta", 20.0), late=(SLOW, -SLOW)),
    "forces with a bias of 0.2 N": Mismatch(sensors=biased(0.2, -0.1), biased=True),
    "forces with a bias of 2 N": Mismatch(sensors=biased(2.0, -1.0), biased=True, slack=5e-3),
    "forces 5 % too large": Mismatch(sensors=gained(1.05, 1.05), gain=1.05),
    "F_x 3 % too large": Mismatch(sensors=gained(1.03, 1.0)),
}

CASES = {**IN_THE_MODEL, **NOT_IN_THE_MODEL, **SENSORS}
