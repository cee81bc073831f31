"""What the control laws do on training draws: tables of docs/classical-control.md, in a minute of one core.

    python docs/make/classical.py

The laws have the gains that the package ships. `fill.py --results` makes the leaderboards of that page.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import tyro
from numpy.typing import NDArray
from pages import BELOW, joined, put_block, signed, table

from pter_gym._engine.batch import Batch
from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark._measures import column, four
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark._standard import TIME_CONSTANTS
from pter_gym.benchmark.metrics import score_episodes
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.benchmark.simulation import sensors_of, simulate, time_limit
from pter_gym.benchmark.tuned import TUNED, find_tuned
from pter_gym.hands import HumanArm
from pter_gym.params import BASELINE, Machine
from pter_gym.paths import Arc, Circle
from pter_gym.scenarios import PACES, find_pace, find_scenario
from pter_gym.tasks.path_following import PathFollowing

PAGE = "docs/classical-control.md"
LAWS = ("impedance", "torque-feedback", *TUNED)
CHANGED = ("impedance-tuned", "single-dof-tuned")
"""Laws that are tried on other clutches."""

TORQUES = (0.5, 0.75, 1.0, 1.5, 2.0)
DRAWS, SEED = 64, 5000
NOTE = f"{DRAWS} training draws of `standard`, seeds {SEED} to {SEED + DRAWS - 1}."
LOST_DRAWS = 256
SATURATED = 1.0 - 1e-6
"""Part of the largest voltage from which a clutch counts as saturated."""

Array = NDArray[np.float64]


@cache
def drawn_task(pace: str) -> PathFollowing:
    """Return the task of ``standard`` at a pace; its draws differ by the seed of the reset alone."""
    return find_scenario("standard").randomisation(find_pace(pace), contexts=1).pairs()[0][1]


def episodes(policy: str, pace: str, machine: Machine = BASELINE, *, draws: int = DRAWS) -> Array:
    """Return the telemetry of a policy on training draws of ``standard``, (steps + 1, draws, len(TELEMETRY))."""
    task = drawn_task(pace)
    found = find_policy(policy, scenario="standard")
    batch = Batch(machine, task, draws, sensors=sensors_of(found))
    return simulate(batch, found, range(SEED, SEED + draws), time_limit(task))


def stuck_clutches(mode: Array) -> NDArray[np.bool_]:
    """Return which clutches do not slip in the modes of a telemetry (…), shape (…, 4)."""
    return (mode[..., None] == np.arange(1, 5)) | (mode[..., None] == ClutchMode.ZERO_DOF)


def use_of(policy: str, pace: str) -> list[str]:
    """Return what a law does with the clutches at a pace."""
    telemetry = episodes(policy, pace)
    steps = telemetry[1:][np.isfinite(column(telemetry[1:], "time"))]
    volts, mode = four(steps, "volts"), column(steps, "mode")
    saturated = (volts >= SATURATED * BASELINE.clutch.voltage_max).any(axis=1)
    at_rest = mode == ClutchMode.ZERO_DOF
    one_stuck = (mode != ClutchMode.TWO_DOF) & ~at_rest
    error = score_episodes(telemetry, [drawn_task(pace)] * DRAWS)["path_error_m"].mean()
    return [
        f"`{policy}`",
        f"{1000 * float(error):.1f}",
        signed(f"{1000 * column(steps, 'normal_error').mean():+z.1f}"),
        joined(", ".join(f"{volt:.1f}" for volt in volts.mean(axis=0))),
        *(f"{100 * each.mean():.0f}" for each in (saturated, one_stuck, at_rest)),
        joined(", ".join(f"{100 * share:.0f}" for share in stuck_clutches(mode).mean(axis=0))),
    ]


def separation() -> str:
    """What the laws do with the clutches."""
    header = ["Law", "path error [mm]", "signed error [mm]", "volts, clutches 1 to 4", "saturated [%]"]
    header += ["one stuck [%]", "at rest [%]", "stuck, clutches 1 to 4 [%]"]
    parts = [f"{NOTE} Means over episodes; the last five over time.\n"]
    for pace, speed in PACES.items():
        rows = [use_of(name, pace) for name in LAWS]
        parts.append(f"{pace.capitalize()} pace, {speed:g} m/s:\n\n{table(header, rows)}")
    return "\n".join(parts)


def changed(torque: float = 1.0, time_constant: float | None = None) -> Machine:
    """Return the machine with other clutches: torques over those of the present ones, and a time constant [s]."""
    clutch = BASELINE.clutch
    breakaway, dynamic = (curve.scaled(torque) for curve in (clutch.breakaway, clutch.dynamic))
    lag = clutch.time_constant if time_constant is None else time_constant
    return replace(BASELINE, clutch=replace(clutch, breakaway=breakaway, dynamic=dynamic, time_constant=lag))


def error_on(machine: Machine, policy: str, pace: str) -> str:
    """Return a law's path error in mm, marked where arrivals or pace miss the leaderboard's limits.

    It has its own gains and knows the machine's torque curve.
    """
    law = find_tuned(policy, "standard").at(PACES[pace])
    task = drawn_task(pace)
    batch = Batch(machine, task, DRAWS)
    telemetry = simulate(batch, law.bind(machine, batch.layout), range(SEED, SEED + DRAWS), time_limit(task))
    scores = score_episodes(telemetry, [task] * DRAWS)
    keeps = scores["completed"].mean() >= COMPLETION
    keeps &= max(scores[name].mean() for name in ("mean_pace_error", "segment_pace_error")) <= PACE_ERROR
    return f"{1000 * float(scores['path_error_m'].mean()):.1f}{'' if keeps else f' {BELOW}'}"


def sweep(machines: Mapping[str, Machine], title: str) -> str:
    """Own gains on a row of machines."""
    rows = [
        [f"`{law}`, {pace}", *(error_on(machine, law, pace) for machine in machines.values())]
        for law in CHANGED
        for pace in PACES
    ]
    return f"{NOTE}\n\n{table([title, *machines], rows)}"


def groups(pairs: Iterable[tuple[Machine, PathFollowing]]) -> dict[str, NDArray[np.bool_]]:
    """Return which draws of ``everything`` belong together."""
    kinds = [(m.clutch.time_constant, t.sensing.delay, type(t.path), type(t.hand)) for m, t in pairs]
    lag, delay, path, hand = (np.array(each) for each in zip(*kinds, strict=True))
    bends, arm = (path == Arc) | (path == Circle), hand == HumanArm
    return {
        "all": lag > 0.0,
        "τ < 0.12 s": lag < 0.12,
        "τ ≥ 0.12 s": lag >= 0.12,
        "no delay": delay == 0,
        "20 ms": delay == 2,
        "arcs, circles": bends,
        "other paths": ~bends,
        "human arms": arm,
        "forces": ~arm,
    }


def arrivals(name: str, pairs: Sequence[tuple[Machine, PathFollowing]], seed: int) -> NDArray[np.bool_]:
    """Return whether a law with the gains for ``everything`` arrives, for each pair of machine and task."""
    machines, tasks = (list(each) for each in zip(*pairs, strict=True))
    law, seeds = find_tuned(name, "everything"), range(seed, seed + len(pairs))
    telemetry = simulate(Batch(machines, tasks), law, seeds, max(map(time_limit, tasks)))
    return (column(telemetry[1:], "is_success") == 1.0).any(axis=0)


def lost() -> str:
    """Which training draws of `everything` do not end at the end of the path."""
    rows: list[list[str]] = []
    header: list[str] = []
    for pace in PACES:
        pairs = find_scenario("everything").randomisation(pace, contexts=LOST_DRAWS, seed=SEED).pairs()
        members = groups(pairs)
        header = ["Lost [%]", *members]
        for name in TUNED:
            starts = range(0, LOST_DRAWS, DRAWS)
            arrived = np.concatenate([arrivals(name, pairs[k : k + DRAWS], SEED + k) for k in starts])
            shares = (100 * (1 - arrived[own].mean()) for own in members.values())
            rows.append([f"`{name}`, {pace}", *(f"{share:.0f}" for share in shares)])
    note = f"{LOST_DRAWS} training draws of `everything`, seed {SEED}: share that does not end at the end of the path."
    return f"{note}\n\n{table(header, rows)}"


def main(write: bool = True) -> None:
    """Write the tables into the page, or print them."""
    lags = {f"{lag:g} s": changed(time_constant=lag) for lag in TIME_CONSTANTS}
    torques = {f"{torque:g}": changed(torque) for torque in TORQUES}
    put_block(PAGE, "separation", separation(), write=write)
    put_block(PAGE, "lag", sweep(lags, "Clutch time constant"), write=write)
    put_block(PAGE, "torque", sweep(torques, "Clutch torques, relative"), write=write)
    put_block(PAGE, "lost", lost(), write=write)


if __name__ == "__main__":
    tyro.cli(main)
