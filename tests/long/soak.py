"""Run the engine for very long, with random actions, materials and hands, and look for what must never happen.

    python tests/long/soak.py 1e9

Most steps are made without telemetry. After each round the same worlds go on for two steps with telemetry, which is
where the energy balance is looked at. Fails on a NaN, a unit vector that is not, growing memory or an open balance.
"""

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pter_gym.engine.batch import Batch, Returns
from pter_gym.engine.world import FLAG, ROW, SAME_STEP
from pter_gym.hands import SINES, MultiSineHand
from pter_gym.internal.computer import available_cores
from pter_gym.params import BASELINE, Hand, Machine, with_friction
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import COLUMN, PathFollowing

KINDS = 256
ACTIONS = 64
ROUND = 100
SIZES = 10
UNIT_LIMIT = 1e-12
ENERGY_LIMIT = 1e-12
MEMORY_LIMIT = 8.0
VECTORS = [ROW.motion.cos_a, ROW.motion.cos_b, *(sine.cos for sine in ROW.sines)]


@dataclass
class Findings:
    """The worst of what was seen: not finite numbers, and errors of unit vectors [1] and of the energy balance [1]."""

    steps: int = 0
    episodes: int = 0
    not_finite: int = 0
    unit_error: float = 0.0
    energy_error: float = 0.0


def random_machine(rng: np.random.Generator) -> Machine:
    """A machine of any friction material, time constant and kind of lag, held by a hand with mass and damping."""
    clutch = with_friction(BASELINE.clutch, *rng.uniform(0.2, 1.2, 2))
    lag = "voltage" if rng.random() < 0.3 else "normal_force"
    hand = Hand(mass=rng.uniform(0.0, 3.0), damping=rng.uniform(0.0, 30.0))
    return replace(BASELINE, clutch=replace(clutch, time_constant=rng.uniform(0.005, 0.3), lag=lag), hand=hand)


def random_task(rng: np.random.Generator) -> PathFollowing:
    """The task with a hand of any strength, from starts off the path."""
    amplitudes = tuple(rng.uniform(0.0, 30.0, SINES).tolist())
    hand = MultiSineHand(push=rng.uniform(0.0, 120.0), amplitudes=amplitudes, random_phases=True)
    return PathFollowing(start_offset=0.015, hand=hand)


def make(worlds: int, telemetry: bool) -> Batch:
    """Worlds of all kinds, half of them from the scenario ``everything``; the same at each call."""
    rng = np.random.default_rng(0)
    kinds = [(random_machine(rng), random_task(rng)) for _ in range(KINDS // 2)]
    kinds += SCENARIOS["everything"].randomisation(contexts=KINDS // 2).pairs()
    machines, tasks = map(list, zip(*(kinds[k % KINDS] for k in range(worlds)), strict=True))
    return Batch(
        machines,
        tasks,
        sensors="force",
        max_steps=1000,
        telemetry=telemetry,
        num_threads=available_cores(),
    )


def ended(returns: Returns) -> np.ndarray:
    """Which worlds ended in a step, (N,)."""
    return returns.flags[FLAG.terminated] | returns.flags[FLAG.truncated]


def look_at_returns(findings: Findings, returns: Returns) -> None:
    """Count steps, ends and numbers that are not finite."""
    findings.steps += len(returns.rewards)
    findings.episodes += int(ended(returns).sum())
    for part in (returns.obs, returns.rewards, *returns.telemetry[:1]):
        findings.not_finite += part.size - int(np.isfinite(part).sum())


def look_at_state(findings: Findings, batch: Batch) -> None:
    """Look at the unit vectors of all lanes that hold a world, and at the whole state."""
    worlds = batch.get_state()["worlds"]
    lanes = worlds.transpose(0, 2, 1).reshape(-1, worlds.shape[1])[: batch.num_worlds]
    findings.not_finite += lanes.size - int(np.isfinite(lanes).sum())
    for row in VECTORS:
        error = np.abs(np.hypot(lanes[:, row], lanes[:, row + 1]) - 1.0).max()
        findings.unit_error = max(findings.unit_error, float(error))


def look_at_energy(findings: Findings, one: Returns, two: Returns) -> None:
    """Compare the kinetic energy of two successive steps with work, losses and residual, relative to the largest."""
    on = ~(ended(one) | ended(two))
    before, after = one.telemetry[0][on], two.telemetry[0][on]
    work, dissipated, lost, residual = after[:, [*COLUMN.energy]].T
    change = after[:, COLUMN.kinetic_energy] - before[:, COLUMN.kinetic_energy]
    terms = np.abs(
        [after[:, COLUMN.kinetic_energy], before[:, COLUMN.kinetic_energy], work, dissipated, lost, residual]
    ).max(axis=0)
    error = np.abs(change - (work - dissipated - lost + residual)) / np.maximum(terms, 1e-9)
    findings.energy_error = max(findings.energy_error, float(error.max(initial=0.0)))


def memory() -> float:
    """What this process has in memory [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def soak(steps: int, worlds: int) -> bool:
    """Run, print what was found, and tell whether all is well."""
    rng = np.random.default_rng(1)
    actions = rng.random((ACTIONS, worlds, 4)) * 24.0 * (rng.random((ACTIONS, worlds, 4)) < 0.6)
    fast, recorded = make(worlds, telemetry=False), make(worlds, telemetry=True)
    fast.reset(list(range(worlds)))
    findings, sizes, begin, shown = Findings(), [], time.perf_counter(), 0
    while findings.steps < steps:
        for _ in range(ROUND):
            look_at_returns(findings, fast.step(actions[rng.integers(ACTIONS)], SAME_STEP))
        recorded.set_state(fast.get_state())
        pair = [recorded.step(actions[rng.integers(ACTIONS)], SAME_STEP) for _ in range(2)]
        for returns in pair:
            look_at_returns(findings, returns)
        look_at_energy(findings, *pair)
        look_at_state(findings, recorded)
        fast.set_state(recorded.get_state())
        sizes.append(memory())
        if findings.steps * 10 // steps > shown:
            shown = findings.steps * 10 // steps
            print(
                f"{findings.steps:.3g} env-steps, {time.perf_counter() - begin:.0f} s, {sizes[-1]:.0f} MB", flush=True
            )
    start, end = max(sizes[:SIZES]), max(sizes[-SIZES:])
    print(f"env-steps              {findings.steps} in {time.perf_counter() - begin:.0f} s, {worlds} worlds")
    print(f"episodes               {findings.episodes}")
    print(f"not finite             {findings.not_finite}")
    print(f"unit vectors, error    {findings.unit_error:.2g} (limit {UNIT_LIMIT:g})")
    print(f"energy balance, error  {findings.energy_error:.2g} of the largest term (limit {ENERGY_LIMIT:g})")
    print(
        f"memory                 {start:.1f} MB at the start, {end:.1f} MB at the end (limit {MEMORY_LIMIT:g} MB more)"
    )
    errors = findings.unit_error <= UNIT_LIMIT and findings.energy_error <= ENERGY_LIMIT
    return findings.not_finite == 0 and errors and end - start <= MEMORY_LIMIT


def main() -> int:
    """Read the arguments and run; 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="?", type=float, default=1e9, help="env-steps in all worlds together")
    parser.add_argument("--worlds", type=int, default=16_384)
    arguments = parser.parse_args()
    return int(not soak(int(arguments.steps), arguments.worlds))


if __name__ == "__main__":
    sys.exit(main())
