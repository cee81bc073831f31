"""How far policies are from the best possible: docs/bound.md. Needs the extra `jax`; takes hours of CPU time in all.

    python docs/make/bound.py                rides what is missing, one run on each core, then makes the page
    python docs/make/bound.py --minutes 60   stops beginning new runs after an hour; the next call goes on
    python docs/make/bound.py --no-ride      makes the page of what there is

A run is a line of docs/make/bound.jsonl: `EPISODES` fresh episodes of a scenario at a pace, of the seed `FRESH`, with
which nothing is tuned or chosen. Each episode's voltages are optimised with knowledge of its whole disturbance, from
the three best rides of laws and shipped policies. A step of the optimisation linearises the ride, solves the
linear–quadratic problem that has the score's gradient, and rides with fractions of the change of the voltages, and with
feedback, without which the smallest change would grow along the path. It keeps what scores better. Last, the benchmark
scores the best voltages, replayed as a policy that ignores its observations.
"""

import json
from collections.abc import Iterator
from importlib import import_module
from math import log10
from pathlib import Path
from statistics import mean
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import tyro
from cores import finished, perform
from numpy.typing import NDArray

from pter_gym.scenarios import PACES, SCENARIOS

Array = NDArray[np.float64]

SCRIPT = Path(__file__).resolve()

FRESH = 20261125
"""Seed of the fresh episodes."""

EPISODES, BLOCKS = 25, 4
"""Episodes of a run, and runs for each scenario and pace."""

STARTS = 3
ITERATIONS = 150
SHARES = np.array([1.0, 0.5, 0.25, 0.1, 0.03, 0.01])
"""Of a change of the voltages; the best one is kept if it is better than none."""

PRICE = 0.3
"""Of a pace error beyond the limit of a rank, in a ride's score [m]."""

DAMPING, SHARPNESS, HOLD = (1e-9, 1e-4), (1e-4, 1e-3), (1e2, 3e4)
"""Ranges from which each step draws: price of a squared voltage's change [m/V²], error at which the score's kink is
rounded [m], and price of a squared change of the place on the path, summed over a ride [1/m]."""

SCORES = ("path_error_m", "mean_pace_error", "segment_pace_error", "completed")


class Run(NamedTuple):
    """A block of episodes of a scenario at a pace."""

    block: int
    scenario: str
    pace: str


def planned() -> Iterator[Run]:
    """Return all runs, the first block of everything first."""
    for block in range(BLOCKS):
        for scenario in SCENARIOS:
            yield from (Run(block, scenario, pace) for pace in PACES)


def score_of(s: Any, error: Any, length: Any, pace: Any, period: float) -> Any:
    """Return a finished ride's score [m] as JAX differentiates it, by arc lengths and normal errors (T + 1,).

    It is `Travel.path_error` but for steps back, whose errors it does not count, plus what the pace costs.
    """
    import jax.numpy as jnp
    from jax.lax import cummax

    from pter_gym.benchmark._measures import SEGMENTS
    from pter_gym.benchmark._recorded import PRICE as POWER
    from pter_gym.tasks.path_following._rules import ALLOWANCE, START

    furthest, size = cummax(s), jnp.abs(error)
    time = period * jnp.arange(len(s), dtype=s.dtype)
    in_time, on_way = (
        jnp.concatenate([jnp.zeros(1), jnp.cumsum(step * size[1:])]) for step in (jnp.diff(time), jnp.diff(furthest))
    )
    marks = length * jnp.array([START, *np.linspace(0.0, 1.0, SEGMENTS + 1)[1:]])
    after = jnp.argmax(furthest >= marks[:, None], axis=1)
    part = (marks - furthest[after - 1]) / (furthest[after] - furthest[after - 1])

    def between(values: Any) -> Any:
        found = values[after - 1] + part * (values[after] - values[after - 1])
        return jnp.diff(found.at[0].set(0.0))

    begun = time[after[0] - 1] + part[0] * period
    lost = jnp.clip(begun - length * START / pace, 0.0, ALLOWANCE)
    spent = between(time).at[0].add(-lost)
    ratio = spent * pace * SEGMENTS / length
    larger = jnp.maximum(between(in_time) / spent, between(on_way) * SEGMENTS / length)
    factor = jnp.where(ratio > 1.0, ratio**POWER, 1.0 + POWER * (1.0 - ratio))
    return (larger * factor).mean() + cost_of_pace(jnp.abs(ratio.mean() - 1.0), jnp.abs(ratio - 1.0).mean())


def cost_of_pace(*errors: Any) -> Any:
    """Return what pace errors beyond the limit cost [m]."""
    from pter_gym.benchmark.ranking import PACE_ERROR

    return sum(PRICE * (each - PACE_ERROR).clip(0.0) for each in errors)


def quadratic_step(linear: Any, volts: Array, top: float, gradient: Array, weight: Array, damping: Array) -> Any:
    """Return the change of the voltages (T, W, 4) that is best for a quadratic cost, and the gains of its feedback.

    ``gradient`` and ``weight`` (T + 1, W, 2) are the cost's derivatives by arc length and normal error. Voltages that
    are at a bound and would go beyond stay there.
    """
    step, gains = np.empty_like(volts), np.empty((*volts.shape, linear.a.shape[-1]))
    by_x = np.einsum("twy,twyx->twx", gradient, linear.c)
    by_xx = np.einsum("twyx,twy,twyz->twxz", linear.c, weight, linear.c)
    value, curvature = by_x[-1], by_xx[-1]
    for n in range(len(volts) - 1, -1, -1):
        a, b = linear.a[n], linear.b[n]
        b_t = b.swapaxes(1, 2)
        by_u = (b_t @ value[..., None])[..., 0]
        free = ~(((volts[n] <= 0.0) & (by_u > 0.0)) | ((volts[n] >= top) & (by_u < 0.0)))
        by_ux = b_t @ curvature @ a
        by_uu = b_t @ curvature @ b + damping[:, None, None] * np.eye(4)
        held = np.where(free[:, :, None] & free[:, None, :], by_uu, np.eye(4))
        right = np.concatenate([by_u[..., None], by_ux], axis=2) * free[..., None]
        solved: Array = -np.linalg.solve(held, right)
        step[n], gains[n] = solved[..., 0], solved[..., 1:]
        to_x = a.swapaxes(1, 2)
        value = by_x[n] + (to_x @ value[..., None] + by_ux.swapaxes(1, 2) @ step[n][..., None])[..., 0]
        curvature = by_xx[n] + to_x @ curvature @ a + by_ux.swapaxes(1, 2) @ gains[n]
        curvature = 0.5 * (curvature + curvature.swapaxes(1, 2))
    return step, gains


def scores_of(ridden: Any, tasks: Any) -> Array:
    """Return the scores of rides (W,) by which they are compared [m]: none where the end was not reached."""
    from pter_gym.benchmark._recorded import Travel

    travel = Travel(ridden.time, ridden.arc_length, ridden.normal_error, ridden.success, tasks)
    price = cost_of_pace(travel.mean_pace_error(), travel.segment_pace_error())
    return np.where(travel.completed(), travel.path_error() + price, np.inf)


def optimise(episodes: Any, volts: Array, rng: Any) -> tuple[Array, Array, float]:
    """Return better voltages than those of W rides (T, W, 4), their scores (W,), and the largest `Linear.apart`."""
    from rides import Ridden, Rides

    jax: Any = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    copies, worlds = len(SHARES), volts.shape[1]
    times = worlds // len(episodes)
    tasks = [*episodes.tasks] * times
    length, pace = np.array([[task.path.length, task.pace] for task in tasks]).T
    differentiate = jax.jit(jax.vmap(jax.grad(score_of, argnums=(0, 1)), (1, 1, 0, 0, None), 1))
    rides = Rides([*episodes.machines] * times, tasks, [*episodes.seeds] * times, copies)
    top = episodes.machines[0].clutch.voltage_max

    def drawn(low: float, high: float) -> Array:
        return np.power(10.0, rng.uniform(log10(low), log10(high), worlds))

    copied = rides.follow(np.repeat(volts[:, None], copies, axis=1))
    best = Ridden(*(each[:, 0].copy() for each in copied))
    scores, apart = scores_of(best, tasks), 0.0
    for _ in range(ITERATIONS):
        linear = rides.linearise(best)
        apart = max(apart, linear.apart)
        error = np.nan_to_num(best.normal_error)
        given = np.where(np.isfinite(best.arc_length), best.arc_length, np.nanmax(best.arc_length, axis=0)), error
        gradient: Array = np.nan_to_num(np.stack(differentiate(*given, length, pace, tasks[0].control_period), axis=-1))
        damping, sharpness, hold = (drawn(*each) for each in (DAMPING, SHARPNESS, HOLD))
        weight = np.abs(gradient) / np.maximum(np.abs(error), sharpness)[..., None]
        weight[..., 0] = hold / len(volts) * np.isfinite(best.time)
        step, gains = quadratic_step(linear, best.volts, top, gradient, weight, damping)
        tried = rides.follow(best.volts[:, None] + SHARES[:, None, None] * step[:, None], best.states, gains)
        found = np.array([scores_of(Ridden(*(each[:, k] for each in tried)), tasks) for k in range(copies)])
        chosen = found.argmin(axis=0)
        (better,) = np.nonzero(found.min(axis=0) < scores)
        scores[better] = found[chosen[better], better]
        for mine, theirs in zip(best, tried, strict=True):
            mine[:, better] = theirs[:, chosen[better], better]
    return best.volts, scores, apart


class Replayed:
    """A policy that applies voltages (T, W, 4) and looks at nothing."""

    def __init__(self, volts: Array) -> None:
        self._volts, self._step = volts, 0

    def reset(self) -> None:
        self._step = 0

    def __call__(self, _: Any) -> Array:
        self._step += 1
        return self._volts[min(self._step, len(self._volts)) - 1].astype(np.float32)


def one(run: Run) -> dict[str, Any]:
    """Return the scores of all policies and of the optimised voltages on a block of episodes."""
    from dataclasses import replace

    from pter_gym.benchmark._evaluation import Batches, bind_once, evaluate
    from pter_gym.benchmark._naming import find_policy
    from pter_gym.benchmark.episodes import find_episodes
    from pter_gym.benchmark.simulation import simulate
    from pter_gym.benchmark.tuned import TUNED
    from pter_gym.policies import shipped_policies
    from pter_gym.tasks.path_following import COLUMN

    begun = process_time()
    every, block = find_episodes(run.scenario, run.pace, FRESH), slice(run.block * EPISODES, (run.block + 1) * EPISODES)
    parts = ("machines", "tasks", "seeds", "strata")
    episodes = replace(every, **{name: getattr(every, name)[block] for name in parts})
    batches = Batches(episodes)

    def judged(policy: Any) -> dict[str, list[float]]:
        scores, _, _ = evaluate(bind_once(policy), batches, 1)
        return {name: [float(f"{value:.5g}") for value in scores[name].tolist()] for name in SCORES}

    needed = max(task.path.length / (task.pace * task.control_period) for task in episodes.tasks)
    steps = 60 + int(1.25 * needed)
    found: dict[str, Any] = {}
    volts: list[Array] = []
    for name in (*TUNED, *shipped_policies()):
        policy = find_policy(name, 0, run.scenario)
        found[name] = judged(policy)
        acting = bind_once(policy)
        rode: Any = simulate(batches.batch(0, acting.sensors), acting.policy, episodes.seeds, steps)
        applied = np.zeros((steps, EPISODES, 4))
        applied[: len(rode) - 1] = np.nan_to_num(rode[1:, :, [*COLUMN.volts]])
        volts.append(applied)
    errors: Any = np.array([np.where(each["completed"], each["path_error_m"], np.inf) for each in found.values()])
    starts = errors.argsort(axis=0)[:STARTS]
    chosen = np.array(volts)[starts, :, np.arange(EPISODES)]
    rng = np.random.default_rng([FRESH, *json.dumps(run).encode()])
    better, scores, apart = optimise(episodes, np.moveaxis(chosen.reshape(-1, *chosen.shape[2:]), 0, 1), rng)
    first = scores.reshape(STARTS, EPISODES).argmin(axis=0)
    best = Replayed(better[:, first * EPISODES + np.arange(EPISODES)])
    return {"bound": judged(best), **found, "apart": apart, "seconds": round(process_time() - begun)}


def known() -> dict[Run, dict[str, Any]]:
    """Return the runs that are finished."""
    return {Run(*run): found for run, found in finished(SCRIPT)}


def tell(run: Run, found: dict[str, Any]) -> str:
    """Return a line about a run: its cost, and path errors [mm]."""
    bound, residual = (1000.0 * mean(found[name]["path_error_m"]) for name in ("bound", "residual"))
    return f"{' '.join(map(str, run))} {found['seconds']} s: bound {bound:.2f}, residual {residual:.2f} mm"


def main(minutes: float = 600.0, only: str = "", no_ride: bool = False) -> None:
    """Ride what is missing, and make the page; ``only`` is for the processes that ride."""
    if only:
        print(json.dumps(one(Run(*json.loads(only)))))
        return
    if not no_ride:
        perform(SCRIPT, known(), planned(), minutes, tell)
    from bound_page import make

    make(known())


if __name__ == "__main__":
    tyro.cli(main)
