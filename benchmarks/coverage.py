"""What `pter identify` says of logs with defects: grades, ρ, and how often intervals hold.

    python benchmarks/coverage.py [SEEDS]

Prints a row for each defect, from 10 simulated logs of one machine with friction of the axes and
14-bit encoders. Takes about ten seconds for a log.
"""

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracle.experiment import Experiment, Recorder, record_log
from pter_gym.params import BASELINE
from pter_gym.tools.identification import Log, identify, quantities, read_log
from pter_gym.tools.identification.log import LOG_COLUMNS

Array = NDArray[np.float64]

ARM = replace(
    BASELINE.arm,
    inertia_a=0.7,
    inertia_b=0.6,
    coupling=0.1,
    dry_a=0.4,
    dry_b=0.3,
    viscous_a=0.2,
    viscous_b=0.1,
)
MACHINE = replace(BASELINE, arm=ARM, clutch_scale=(0.9, 1.1, 1.05, 0.95))
SHORT = Experiment(levels=(20.5, 6.0, 22.0, 14.0, 20.5), on=0.9, off=0.25, free=4.0)
DELAY = 0.012


@dataclass(frozen=True)
class Defect:
    """What is unlike the model, and the true numbers; links are said to be so much ``longer``."""

    torque: Callable[[Array], Array] | None = None
    change: Callable[[Log, np.random.Generator], Log] = lambda log, _: log
    longer: float = 1.0
    offsets: tuple[float, float] = (0.0, 0.0)
    force_delay: float = 0.0


def drifting(log: Log, _: np.random.Generator) -> Log:
    """Return a log whose force sensor drifts by 1 N."""
    drift = np.linspace(0.0, 1.0, len(log.force))[:, None]
    return replace(log, force=log.force + drift * [1.0, -1.0])


def late(time: float, log: Log, _: np.random.Generator) -> Log:
    """Return a log with forces that were recorded a time [s] late."""
    when = log.times - time
    force = np.column_stack([np.interp(when, log.times, each) for each in log.force.T])
    return replace(log, force=force)


def through_file(log: Log, times: Array) -> Log:
    """Return a log that was sampled at other times [s], and read from its file."""
    row = np.searchsorted(log.times, times + 1e-9, side="right") - 1
    moved = [np.interp(times, log.times, each) for each in (*log.theta.T, *log.force.T)]
    with TemporaryDirectory() as folder:
        file, table = Path(folder) / "log.csv", np.column_stack([times, log.volts[row], *moved])
        np.savetxt(file, table, "%.9g", ",", header=",".join(LOG_COLUMNS), comments="")
        return read_log(file)


def wandering(log: Log, rng: np.random.Generator) -> Log:
    """Return a log by a clock whose period wanders by 0.2 %, with 30 µs of jitter."""
    way = np.linspace(0.0, 2.0 * np.pi, len(log.times))
    times = np.cumsum(log.interval * (1.0 + 1e-3 * np.sin(way + rng.uniform(0.0, 6.0))))
    times += 3e-5 * rng.standard_normal(len(times))
    return through_file(log, times[(times >= 0.0) & (times <= log.duration)])


def gappy(log: Log, rng: np.random.Generator) -> Log:
    """Return a log without 40 stretches of 20 ms."""
    gaps = rng.uniform(0.0, log.duration, 40)
    lost = ((log.times[:, None] > gaps) & (log.times[:, None] < gaps + 0.02)).any(axis=1)
    return through_file(log, log.times[~lost])


def apart(log: Log, _: np.random.Generator) -> Log:
    """Return a log in which each sensor has rows of its own, and forces every second one."""
    lines = [",".join(LOG_COLUMNS)]
    changed = np.diff(log.volts, axis=0, prepend=-1.0).any(axis=1)
    for k, t in enumerate(log.times):
        volts, (a, b), (x, y) = (each[k] for each in (log.volts, log.theta, log.force))
        lines += [f"{t:.7f},{','.join(f'{v:g}' for v in volts)},,,,"] if changed[k] else []
        lines += [f"{t + 1e-5:.7f},,,,,{a:.9g},,,", f"{t + 2e-5:.7f},,,,,,{b:.9g},,"]
        lines += [f"{t + 7e-4:.7f},,,,,,,{x:.9g},{y:.9g}"] if k % 2 == 0 else []
    with TemporaryDirectory() as folder:
        file = Path(folder) / "log.csv"
        file.write_text("\n".join(lines), "utf-8")
        return read_log(file)


DEFECTS = {
    "none": Defect(),
    "constant torques of ±0.05 N·m": Defect(
        lambda theta: np.broadcast_to([0.05, -0.05], theta.shape), offsets=(0.05, -0.05)
    ),
    "cogging, 0.05 N·m twelve times a turn": Defect(lambda theta: 0.05 * np.sin(12.0 * theta)),
    "force sensor that drifts by 1 N": Defect(change=drifting),
    "lengths 2 % too long": Defect(longer=1.02),
    "forces 0.7 ms late": Defect(change=partial(late, 7e-4), force_delay=7e-4),
    "forces 5 ms late": Defect(change=partial(late, 5e-3), force_delay=5e-3),
    "clock that wanders by 0.2 %": Defect(change=wandering),
    "40 gaps of 20 ms": Defect(change=gappy),
    "sensors in rows of their own, forces 0.7 ms late": Defect(change=apart, force_delay=7e-4),
}


def main(seeds: int) -> None:
    """Print the table."""
    print("| Defect | Grades | ρ | intervals hold | identified | of those within 5 % | largest |")
    print("|---|---|---:|---:|---:|---:|---:|")
    for name, defect in DEFECTS.items():
        grades, rho = Counter[str](), list[float]()
        off, held, sure = list[float](), list[bool](), list[bool]()
        for seed in range(seeds):
            log = record_log(MACHINE, SHORT, Recorder(delay=DELAY), seed, defect.torque)
            log = defect.change(log, np.random.default_rng(seed))
            lengths = {key: defect.longer * getattr(ARM, key) for key in ("length_a", "length_b")}
            found = identify(log, replace(BASELINE, arm=replace(BASELINE.arm, **lengths)))
            grades[found.verdict.grade] += 1
            rho.append(found.verdict.rho)
            top = found.fit.shape.top
            true = quantities(MACHINE, DELAY, top, defect.offsets, defect.force_delay)
            for finding, q in zip(found.findings, true, strict=True):
                if finding.status != "kept" and np.isfinite(finding.high):
                    off.append(abs(finding.quantity.value - q.value) / q.scale)
                    held.append(finding.low <= q.value <= finding.high)
                    sure.append(finding.status == "identified")
        said = ", ".join(f"{grade} {count}" for grade, count in grades.items())
        errors = np.array(off)[np.array(sure, bool)] if off else np.empty(0)
        print(
            f"| {name} | {said} | {100 * min(rho):.2f} to {100 * max(rho):.2f} % "
            f"| {sum(held)} of {len(held)} | {len(errors)} | {int((errors <= 0.05).sum())} "
            f"| {100 * errors.max(initial=0.0):.1f} % |",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
