"""Measure how much a score depends on the integrator's step, and fill the table of docs/scoring.md.

    python docs/make/steps.py --out steps.json             measures what the file lacks; 20 minutes in all
    python docs/make/steps.py --out steps.json --write     fills the table too

The same training draws of a scenario are ridden by the same policies at the shipped substep and at ``FINE``. Chaotic
rides differ after a second or two, so a difference has a standard error, by bootstrap over the draws.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from pages import put_block, signed, table

from pter_gym._engine.batch import Batch
from pter_gym._internal.files import write_text_atomic
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark.metrics import score
from pter_gym.benchmark.simulation import sensors_of, simulate, time_limit
from pter_gym.benchmark.statistics import mean, resample
from pter_gym.benchmark.tuned import TUNED
from pter_gym.controllers import bind
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import PACES, SCENARIOS

FINE = 5e-5
"""The substep that stands for none [s]."""

LEAST = 0.05
"""Smallest standard error that counts [%]: some laws' rides do not part at all."""

MEASURES = ("path_error_m", "rms_acceleration_m_s2", "peak_acceleration_m_s2")


def main(out: Path, draws: int = 200, seed: int = 77, write: bool = False) -> None:
    """Measure, and print the table or write it to its page.

    Parameters
    ----------
    out
        File of the measurements.
    draws, seed
        How many draws of each scenario and pace, and their seed.
    write
        Whether to write to docs/scoring.md.
    """
    found: dict[str, list[list[float]]] = json.loads(out.read_text("utf-8")) if out.exists() else {}
    for scenario, policy, pace in cases():
        key = f"{scenario} {policy} {pace} {draws} {seed}"
        if key not in found:
            found[key] = measured(scenario, policy, pace, draws, seed)
            write_text_atomic(out, json.dumps(found, indent=1) + "\n")
            print(key, *found[key], flush=True)
    rows = (
        (scenario, f"`{policy}`", *(cell(found[f"{scenario} {policy} {pace} {draws} {seed}"]) for pace in PACES))
        for scenario, policy in dict.fromkeys((scenario, policy) for scenario, policy, _ in cases())
    )
    shown = table(("Scenario", "Policy", *PACES), rows, "---")
    put_block("docs/scoring.md", "by the step", f"{shown}\n{summary(np.array(list(found.values())))}\n", write=write)


def cases() -> Iterator[tuple[str, str, str]]:
    """Yield scenario, policy and pace of what is measured; ``ppo-standard`` knows one scenario."""
    for scenario in SCENARIOS:
        for policy in (*TUNED, *shipped_policies()):
            if scenario == "standard" or policy != "ppo-standard":
                yield from ((scenario, policy, pace) for pace in PACES)


def measured(scenario: str, policy: str, pace: str, draws: int, seed: int) -> list[list[float]]:
    """Return of each measure its value at the shipped step, the change from the fine one [%] and its standard error."""
    pairs = SCENARIOS[scenario].randomisation(pace, contexts=draws, seed=seed).pairs()
    coarse = ridden(scenario, policy, pairs, None)
    fine = ridden(scenario, policy, pairs, FINE)
    chosen = resample(draws, None)
    results: list[list[float]] = []
    for k in range(len(MEASURES)):
        ratios = mean(coarse[chosen, k]) / mean(fine[chosen, k])
        value, exact = float(mean(coarse[:, k])), float(mean(fine[:, k]))
        results.append([value, 100.0 * (value / exact - 1.0), 100.0 * float(np.std(ratios))])
    return results


def ridden(scenario: str, policy: str, pairs: Any, substep: float | None) -> NDArray[np.float64]:
    """Return the measures of a policy's rides, (draws, measures), with another substep [s] if one is given."""
    machines = [machine if substep is None else replace(machine, substep=substep) for machine, _ in pairs]
    tasks = [task for _, task in pairs]
    rider = find_policy(policy, 0, scenario)
    batch = Batch(machines, tasks, sensors=sensors_of(rider), telemetry=True)
    bound = bind(rider, SCENARIOS[scenario].nominal, batch.layout)
    telemetry = simulate(batch, bound, list(range(len(tasks))), max(map(time_limit, tasks)))
    scores = [
        score(rows[~np.isnan(rows[:, 0])], task) for rows, task in zip(telemetry.swapaxes(0, 1), tasks, strict=True)
    ]
    return np.array([[getattr(each, measure) for measure in MEASURES] for each in scores])


def summary(found: NDArray[np.float64]) -> str:
    """Return how the differences of all scores, (cases, measures, 3), compare with their standard errors."""
    change, spread = found[:, 0, 1], np.maximum(found[:, 0, 2], LEAST)
    near, weight = int(np.sum(abs(change) <= 2.0 * spread)), np.sum(spread**-2)
    middle, error = np.sum(change / spread**2) / weight, weight**-0.5
    return (
        f"Of {len(found)} differences of the path error {near} are within two standard errors, where chance alone "
        f"would have {0.954 * len(found):.0f}. Their weighted mean is {signed(f'{middle:+.2f}')} ± {error:.2f} %."
    )


def cell(found: list[list[float]]) -> str:
    """Return the score [mm] and how much it changes with its standard error, then the changes of the accelerations."""
    (error, change, spread), (_, rms, _), (_, peak, _) = found
    changes = f"{signed(f'{change:+.1f}')} ± {spread:.1f}"
    return f"{1e3 * error:.2f}: {changes}; {signed(f'{rms:+.1f}')}, {signed(f'{peak:+.1f}')}"


if __name__ == "__main__":
    tyro.cli(main)
