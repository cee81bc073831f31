"""What the best rollouts of `bound.py` owe to foresight of the force: docs/scoring.md. Needs the extra `jax`.

`python docs/make/foresight.py` rides each scenario that foresight.jsonl lacks, prints path errors [mm] and draws them.
Voltages are optimised from the best policy's ride, for the true force and for its mean (sines and tremor at 0). Both
rides' feedback gains, at several prices, then lead the arm under the true force, or one with other phases.
"""

import json
from dataclasses import replace
from itertools import product
from typing import Any

import bound
import numpy as np
from bound import FRESH, Array, optimise, quadratic_step
from matplotlib.figure import Figure
from pages import IMAGES
from rides import Ridden, Rides

from pter_gym._engine.batch import Batch
from pter_gym.benchmark._evaluation import bind_once
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark._recorded import Travel
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.simulation import simulate
from pter_gym.benchmark.statistics import bootstrap_interval
from pter_gym.hands import SINES
from pter_gym.hands._tremor import TremorArm
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tools.figures import MUTED, WIDTH, numbered, save, styled

PACE, EPISODES, SHARPNESS = "medium", 10, 1e-3
BEST = {"paths": "residual", "tremor": "residual", "standard": "ppo-standard"}  # of bound.jsonl, by the mean
PRICES = tuple(product((1e-9, 1e-8, 1e-7), (1e1, 3e1, 1e2, 3e2, 1e3)))
"""Of a squared change of a voltage [m/V²] and of the place on the path, as in `bound.py`."""
RESULTS = bound.SCRIPT.with_name("foresight.jsonl")


def with_force(task: Any, phases: Any = ()) -> Any:
    """Return a task with other phases of tremor, its swell and all sines; without any, at the mean force."""
    changed: Any = {"phases": tuple(phases[2:])} if phases else {"amplitudes": (0.0,) * SINES}
    if isinstance(task.hand, TremorArm):
        changed |= {"phase": phases[0], "swell_phase": phases[1]} if phases else {"acceleration": 0.0}
    return replace(task, hand=replace(task.hand, **changed))


def scored(episodes: Any, tasks: list[Any], volts: Array, *feedback: Array) -> list[list[float]]:
    """Return path errors [mm], (prices, episodes), of rides at voltages (T, prices × episodes, 4)."""
    times = volts.shape[1] // len(tasks)
    rides = Rides([*episodes.machines] * times, tasks * times, [*episodes.seeds] * times, 1)
    travel = Travel(*(each[:, 0] for each in rides.follow(volts[:, None], *feedback)[2:]), tasks * times)
    return (1000.0 * travel.path_error()).reshape(times, -1).round(4).tolist()


def ride(scenario: str) -> dict[str, list[list[float]]]:
    """Return path errors [mm] of each kind of ride, at all prices where it has feedback."""
    rng, times = np.random.default_rng([FRESH, *scenario.encode()]), len(PRICES)
    one = find_episodes(scenario, PACE, FRESH).first(EPISODES)
    true, mean, known, guess = [*one.tasks], [*map(with_force, one.tasks)], slice(EPISODES), slice(EPISODES, None)
    other = [with_force(task, rng.uniform(0.0, 2.0 * np.pi, SINES + 2).tolist()) for task in true]
    both = replace(one, machines=one.machines * 2, tasks=(*true, *mean), seeds=one.seeds * 2, strata=one.strata * 2)
    steps = 60 + int(1.25 * max(task.path.length / (task.pace * task.control_period) for task in true))
    acting = bind_once(find_policy(BEST[scenario], 0, scenario))
    rode: Any = simulate(Batch(both.machines, both.tasks, sensors=acting.sensors), acting.policy, both.seeds, steps)
    start = np.zeros((steps, len(both), 4))
    start[: len(rode) - 1] = np.nan_to_num(rode[1:, :, [*COLUMN.volts]])
    volts, _, _ = optimise(both, start, rng)
    rides = Rides(both.machines, both.tasks, both.seeds, 1)
    ridden = Ridden(*(each[:, 0] for each in rides.follow(volts[:, None])))
    linear, alive = rides.linearise(ridden), np.isfinite(ridden.time)
    gains: list[Array] = []
    for damping, hold in PRICES:
        weight = np.stack([hold * alive, alive / SHARPNESS], axis=-1) / steps
        free = np.ones_like(volts), 2.0, np.zeros_like(weight)
        gains.append(quadratic_step(linear, *free, weight, np.full(len(both), damping))[1])

    def led(tasks: list[Any], half: slice) -> list[list[float]]:
        nominal = np.tile(volts[:, half], (1, times, 1)), np.tile(ridden.states[:, half], (1, times, 1))
        return scored(one, tasks, *nominal, np.concatenate([each[:, half] for each in gains], axis=1))

    return {
        "best rollout found": scored(one, true, volts[:, known]),
        "its feedback, other phases": led(other, known),
        "best for the mean force": led(true, guess),
        "best policy": scored(one, true, start[:, known]),
        "best rollout, mean force alone": scored(one, mean, volts[:, guess]),
        "best policy, mean force alone": scored(one, mean, start[:, guess]),
    }


@styled
def figure_of(found: dict[str, Any]) -> Figure:
    """Return each episode's path error, and medians with intervals, at the prices with the smallest mean."""
    figure = Figure(figsize=(WIDTH, 2.6))
    panels = figure.subplots(1, len(found), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (scenario, kinds) in zip(panels, found.items(), strict=True):
        for row, (kind, tried) in enumerate(kinds.items()):
            errors = np.array(min(tried, key=np.mean))
            value, low, high = bootstrap_interval(errors, lambda values: np.median(values, axis=-1))
            print(scenario, kind, "mean", bootstrap_interval(errors), "median", (value, low, high))
            axes.scatter(errors, np.full(len(errors), row), 10.0, MUTED, alpha=0.4, linewidths=0.0)
            axes.errorbar(value, row, xerr=[[value - low], [high - value]], fmt="o", color=numbered(row).colour)
            axes.annotate(f"{value:#.2g}", (value, row), (0.0, 5.0), textcoords="offset points", ha="center")
        axes.set(xscale="log", title=f"{scenario}, {PACE}", xlabel="path error [mm]")
        axes.set_xticks((0.1, 1.0, 10.0), ("0.1", "1", "10"))
        axes.grid(visible=False, axis="y")
        axes.set_yticks(range(len(kinds)), [*kinds])
    panels[0].set_ylim(5.5, -0.6)
    return figure


if __name__ == "__main__":
    bound.ITERATIONS = 60
    results = dict(map(json.loads, RESULTS.read_text("utf-8").splitlines())) if RESULTS.exists() else {}
    for name in BEST:
        if name not in results:
            results[name] = ride(name)
            RESULTS.write_text("".join(f"{json.dumps(each)}\n" for each in results.items()), "utf-8")
    save(figure_of(results), IMAGES / "foresight.png")
