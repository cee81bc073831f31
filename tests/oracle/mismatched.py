"""Logs of machines and sensors that differ from the package's assumptions, one or several at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from oracle.recorded import Recorded, record
from pter_gym.tools.identification import Log

Sensors = Callable[[Log], Log]


def as_they_are(log: Log) -> Log:
    return log


@dataclass(frozen=True)
class Case:
    """A machine, what its sensors make of a log, and the gain of the force sensor."""

    machine: Recorded = Recorded()
    sensors: Sensors = as_they_are
    gain: float = 1.0

    def log(self) -> Log:
        return self.sensors(record(self.machine))


def bent(size: float) -> Sensors:
    """Encoders with eccentric discs: errors of a size [rad] over a turn."""
    return lambda log: replace(log, theta=log.theta + size * np.sin(log.theta + [0.4, 1.9]))


def late(time: float) -> Sensors:
    """Forces recorded a time [s] after the angles."""

    def shifted(log: Log) -> Log:
        when = log.times - time
        return replace(log, force=np.column_stack([np.interp(when, log.times, each) for each in log.force.T]))

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
    return lambda log: replace(log, force=log.force + [x, y])


def gained(x: float, y: float) -> Sensors:
    """A force sensor with other gains."""
    return lambda log: replace(log, force=log.force * [x, y])


IN_THE_MODEL = {
    "as assumed": Case(),
    "friction of the axes": Case(Recorded(dry=(0.4, 0.3), viscous=(0.2, 0.1))),
    "Stribeck 0.03": Case(Recorded(stribeck=0.03, rational=True)),
    "Stribeck 0.05": Case(Recorded(stribeck=0.05, rational=True)),
    "Stribeck 0.1": Case(Recorded(stribeck=0.1, rational=True)),
    "Stribeck 0.2": Case(Recorded(stribeck=0.2, rational=True)),
    "Stribeck 0.3": Case(Recorded(stribeck=0.3, rational=True)),
    "off-state torque 0.1": Case(Recorded(off_state=0.1)),
    "off-state torque 0.5": Case(Recorded(off_state=0.5)),
    "drag 0.05": Case(Recorded(drag=0.05)),
    "drag 0.2": Case(Recorded(drag=0.2)),
    "falls twice as fast": Case(Recorded(fall_ratio=0.5)),
    "falls 1.5 times as slowly": Case(Recorded(fall_ratio=1.5)),
    "falls 3 times as slowly": Case(Recorded(fall_ratio=3.0)),
    "Stribeck, off-state torque, fall": Case(Recorded(stribeck=0.1, rational=True, off_state=0.2, fall_ratio=2.0)),
    "a magnetorheological brake": Case(Recorded(off_state=0.3, drag=0.05, time_constant=0.02)),
}

NOT_IN_THE_MODEL = {
    "exponential Stribeck 0.05": Case(Recorded(stribeck=0.05)),
    "exponential Stribeck 0.15": Case(Recorded(stribeck=0.15)),
    "exponential Stribeck 0.3": Case(Recorded(stribeck=0.3)),
    "T_s/T_k of clutch 1 +10 %": Case(Recorded(ratios=(1.1, 1.0, 1.0, 1.0))),
    "T_s/T_k of clutch 2 −10 %": Case(Recorded(ratios=(1.0, 0.9, 1.0, 1.0))),
    "T_s/T_k of clutch 3 +10 %": Case(Recorded(ratios=(1.0, 1.0, 1.1, 1.0))),
    "T_s/T_k of clutch 4 −10 %": Case(Recorded(ratios=(1.0, 1.0, 1.0, 0.9))),
    "fade 0.02 %/J": Case(Recorded(fade=2e-4)),
    "fade 0.2 %/J": Case(Recorded(fade=2e-3)),
    "hysteresis 0.2 V": Case(Recorded(hysteresis=0.2)),
    "hysteresis 1 V": Case(Recorded(hysteresis=1.0)),
    "asymmetry 2 %": Case(Recorded(asymmetry=0.02)),
    "asymmetry 10 %": Case(Recorded(asymmetry=0.1)),
    "torque that grows with the slip": Case(Recorded(growth=0.15)),
    "flexible links": Case(Recorded(link=5000.0)),
}

SENSORS = {
    "angles bent by 1 mrad": Case(sensors=bent(1e-3)),
    "angles bent by 10 mrad": Case(sensors=bent(1e-2)),
    "forces 2 ms late": Case(sensors=late(2e-3)),
    "forces 5 ms late": Case(sensors=late(5e-3)),
    "forces 5 ms early": Case(sensors=late(-5e-3)),
    "forces filtered at 20 Hz": Case(sensors=filtered("force", 20.0)),
    "forces filtered at 60 Hz": Case(sensors=filtered("force", 60.0)),
    "angles filtered at 20 Hz": Case(sensors=filtered("theta", 20.0)),
    "forces with a bias of 0.2 N": Case(sensors=biased(0.2, -0.1)),
    "forces with a bias of 2 N": Case(sensors=biased(2.0, -1.0)),
    "forces 5 % too large": Case(sensors=gained(1.05, 1.05), gain=1.05),
    "F_x 3 % too large": Case(sensors=gained(1.03, 1.0)),
}

CASES = {**IN_THE_MODEL, **NOT_IN_THE_MODEL, **SENSORS}
