"""Identification of simulated machines: how large the errors are, and how often the intervals hold.

    python -m tests.campaigns.identification --machines 100 --processes 2 --write    the table into docs/identify.md
    python -m tests.campaigns.identification --machines 3 --first 7                  machines 7, 8 and 9 alone

A few minutes on two cores; with ``--journal FILE`` a campaign goes on where it was stopped.

Machine number k is drawn from the seed and k: inertias, coupling, torque curve, T_s/T_k, the clutches' own factors,
time constant, delay, friction of the axes, encoders and the noise of the force. Its log is that of the experiment,
simulated with a substep finer than the model's; ``identify`` starts from PTER with the machine's link lengths.
"""

import argparse
import hashlib
import json
import math
import multiprocessing
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import pter_gym
from pter_gym.params import BASELINE, Arm, Clutch, Machine, TorqueCurve
from pter_gym.tools.identification import Identification, Recorder, identify, quantities, record_log
from pter_gym.tools.identification.verdict import MAX_UNEXPLAINED as MOST

PACKAGE = Path(pter_gym.__file__).parent

DECIDING = ("params", "_compiled", "_physics", "gradients", "tools/identification")
"""Rooms of the package whose sources a journal is of."""

PAGE = Path(__file__).parents[2] / "docs" / "identify.md"

SEED = 18

ALLOWED = 0.05
"""Largest error over the scale."""

GROUPS = {
    "inertias": ("inertia_a", "inertia_b"),
    "coupling": ("coupling",),
    "dynamic torque at 4 voltages": ("torque_25", "torque_50", "torque_75", "torque_100"),
    "slope": ("slope",),
    "knee": ("knee",),
    "curvature": ("curvature",),
    "breakaway ratio": ("breakaway_ratio",),
    "factors of the clutches": ("scale_1", "scale_2", "scale_3", "scale_4"),
    "time constant": ("time_constant",),
    "delay": ("delay",),
    "dry friction": ("dry_a", "dry_b"),
    "viscous friction": ("viscous_a", "viscous_b"),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one number of one machine: its error and half of its interval are over the scale."""

    name: str
    status: str
    error: float
    half: float
    inside: bool


class Result(NamedTuple):
    """What came of each number of a machine, the share of windows not explained, and the time taken [s]."""

    outcomes: list[Outcome]
    left: float
    seconds: float


def draw_machine(rng: np.random.Generator) -> Machine:
    """Return a machine unlike PTER."""
    inertia_a, inertia_b = np.exp(rng.uniform(math.log(0.25), math.log(1.5), 2)).tolist()
    slope, knee = float(rng.uniform(0.5, 1.3)), float(rng.uniform(10.0, 19.5))
    top = float(rng.uniform(10.0, 26.0))
    curvature = max(top - 22.0 * slope, 0.1 * top) / (22.0 - knee) ** 2
    dynamic = TorqueCurve(slope=slope, knee=knee, curvature=curvature)
    machine = replace(
        BASELINE,
        arm=Arm(
            length_a=float(rng.uniform(0.42, 0.6)),
            length_b=float(rng.uniform(0.38, 0.5)),
            inertia_a=inertia_a,
            inertia_b=inertia_b,
            coupling=float(rng.uniform(-0.4, 0.4)) * math.sqrt(inertia_a * inertia_b),
        ),
        clutch=Clutch(
            dynamic=dynamic,
            breakaway=dynamic.scaled(float(rng.uniform(1.08, 1.4))),
            time_constant=float(np.exp(rng.uniform(math.log(0.03), math.log(0.2)))),
        ),
        clutch_scale=tuple(rng.uniform(0.85, 1.18, 4).tolist()),
    )
    friction = rng.uniform(-0.5, 1.0, 4).clip(0.0) * [0.6, 0.6, 0.3, 0.3]  # a third of the numbers is zero
    names = ("dry_a", "dry_b", "viscous_a", "viscous_b")
    return replace(machine, arm=replace(machine.arm, **dict(zip(names, friction.tolist(), strict=True))))


def draw_recorder(rng: np.random.Generator) -> Recorder:
    """Return encoders of 12 or 14 bit, forces with noise, and up to 20 ms of delay."""
    return Recorder(
        angle_resolution=2.0 * math.pi / float(rng.choice([4096, 16384])),
        force_noise=float(rng.uniform(0.1, 1.0)),
        delay=float(rng.uniform(0.0, 0.02)),
    )


def identified(number: int) -> Result:
    """Identify a machine by its number."""
    rng = np.random.default_rng([SEED, number])
    machine, recorder = draw_machine(rng), draw_recorder(rng)
    log = record_log(machine, recorder=recorder, seed=number)
    start = replace(BASELINE, arm=replace(BASELINE.arm, length_a=machine.arm.length_a, length_b=machine.arm.length_b))
    began = time.process_time()
    found = identify(log, start)
    return Result(outcomes(found, machine, recorder.delay), found.verdict.share, time.process_time() - began)


def outcomes(found: Identification, machine: Machine, delay: float) -> list[Outcome]:
    """Return the errors of all numbers."""
    mean = float(np.mean(machine.clutch_scale))
    curve = machine.clutch.dynamic.scaled(mean)
    same = replace(
        machine,
        clutch=replace(machine.clutch, dynamic=curve, breakaway=machine.clutch.breakaway.scaled(mean)),
        clutch_scale=tuple(scale / mean for scale in machine.clutch_scale),
    )
    true = quantities(same, delay, found.fit.shape.top)
    return [
        Outcome(
            q.name,
            f.status,
            (f.quantity.value - q.value) / q.scale,
            f.half_width / max(f.quantity.scale, 1e-300),
            f.low <= q.value <= f.high,
        )
        for f, q in zip(found.findings, true, strict=True)
    ]


def table(results: list[Result]) -> str:
    """Return the outcomes of all machines as Markdown."""
    all_outcomes, shares, seconds = map(list, zip(*results, strict=True))
    told = [outcome for each in all_outcomes for outcome in each]
    lines = [
        "| Number | identified | error ≤ 5 % | median error | largest error | interval holds | uncertain | kept |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for group, names in [*GROUPS.items(), ("all", tuple(sum(GROUPS.values(), ())))]:
        own = [outcome for outcome in told if outcome.name in names]
        sure = [outcome for outcome in own if outcome.status == "identified"]
        shown = [outcome for outcome in own if outcome.status != "kept"]
        errors: NDArray[np.float64] = np.abs([outcome.error for outcome in sure] or [math.nan])
        counts = [sum(outcome.status == status for outcome in own) for status in ("uncertain", "kept")]
        lines.append(
            f"| {group} | {len(sure)} of {len(own)} | {share([e <= ALLOWED for e in errors])} | "
            f"{100 * float(np.median(errors)):.2f} % | {100 * float(errors.max()):.1f} % | "
            f"{share([outcome.inside for outcome in shown])} | {counts[0]} | {counts[1]} |"
        )
    clean = sum(all(o.status != "identified" or abs(o.error) <= ALLOWED for o in each) for each in all_outcomes)
    lines.append("")
    lines.append(
        f"On {clean} of {len(all_outcomes)} machines every identified number is within 5 %. The model explains "
        f"{sum(each <= MOST for each in shares)} of the logs; {100 * max(shares):.0f} % of the windows of the worst "
        f"one are not explained. An identification took {np.median(seconds):.0f} s of CPU time on one core "
        f"in the median and {max(seconds):.0f} s at most."
    )
    return "\n".join(lines)


def sources() -> str:
    """Return a digest of the sources that decide, this one among them."""
    files = [Path(__file__), *(file for room in DECIDING for file in sorted((PACKAGE / room).rglob("*.py")))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


class Journal:
    """Machines that were identified before, by the same sources; a line of JSON for each."""

    def __init__(self, file: Path | None) -> None:
        self._file, self._sources = file, sources()
        lines = file.read_text("utf-8").splitlines() if file is not None and file.exists() else []
        kept = [each for each in map(json.loads, lines) if each["sources"] == self._sources]
        self.known = {each["machine"]: Result([Outcome(**o) for o in each["outcomes"]], *each["told"]) for each in kept}

    def add(self, number: int, result: "Result") -> None:
        self.known[number] = result
        if self._file is not None:
            outcomes = [asdict(each) for each in result.outcomes]
            line = {"sources": self._sources, "machine": number, "outcomes": outcomes, "told": result[1:]}
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(line) + "\n")


def share(flags: list[bool]) -> str:
    """Return a share in percent."""
    return f"{100 * sum(flags) / len(flags):.0f} %" if flags else "–"


def main() -> None:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="write the table into docs/identify.md")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--journal", type=Path, help="file that keeps each machine's outcome")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.machines)
    journal = Journal(arguments.journal)
    missing = [number for number in numbers if number not in journal.known]
    with multiprocessing.get_context("spawn").Pool(arguments.processes) as pool:
        for number, result in zip(missing, pool.imap(identified, missing), strict=True):
            journal.add(number, result)
            wrong = [f"{o.name} {100 * o.error:+.2f} ± {100 * o.half:.2f} %" for o in result.outcomes if not o.inside]
            told = "; ".join(wrong) or "inside all intervals"
            print(f"machine {number}, {result.seconds:.0f} s, {result.left:.0%} not explained: {told}", flush=True)
    text = table([journal.known[number] for number in numbers])
    print(text)
    if arguments.write:
        sys.path.insert(0, str(PAGE.parent / "make"))
        from pages import write_block

        write_block(PAGE, "campaign", f"{text}\n")


if __name__ == "__main__":
    main()
