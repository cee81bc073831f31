"""What remains where a clutch fails, and how soon a detector knows.

    python benchmarks/failures.py tune
    python benchmarks/failures.py score FOLDER
    python benchmarks/failures.py detector

``tune`` writes the laws tuned for PTER without each clutch into benchmarks/devices, but those that
are there, about a minute of CPU for each of 24. ``score`` adds runs on the test episodes of
`standard` to a folder of results of ``pter benchmark``, with a clutch dead from the start: of
policies that are told, of policies with a detector, and of the best of these laws; and runs in
which a healthy clutch is called dead. ``detector`` prints how soon a detector names a clutch, and
how often a healthy one, in training episodes. docs/failures.md has the tables; those of ``score``
are filled by ``docs/make/fill.py --results FOLDER``.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from devices import best_law, tune_for

from pter_gym.benchmark import ResultsFolder, ScenarioRun, assess, evaluate, find_policy
from pter_gym.benchmark.episodes import Episodes, find_episodes, training_episodes
from pter_gym.benchmark.faults import faults
from pter_gym.benchmark.results import origin_of
from pter_gym.benchmark.rollout import run_episodes
from pter_gym.controllers import AnyPolicy, FailureDetector
from pter_gym.controllers._detector import without
from pter_gym.params import BASELINE
from pter_gym.policies.find import DETECTOR
from pter_gym.policies.tuned import SCALED
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import Failure

CLUTCHES = range(1, 5)
POLICIES = ("universal", "residual", "single-dof-tuned")

TRIALS, SEED = 100, 2026
"""Gains to try in a search, and the seed of the test episodes."""

DRAWN = 200
"""Training episodes that say which of two laws is better without a clutch."""


def tune(only: Annotated[tuple[int, ...], tyro.conf.Positional] = (*CLUTCHES,)) -> None:
    """Tune laws for PTER without a clutch, by default for each."""
    tune_for({f"without-{clutch}": without(BASELINE, clutch) for clutch in only}, TRIALS)


def best_without(clutch: int, pace: str) -> AnyPolicy:
    """Return the law tuned for PTER without a clutch, or the scaled one if it is better there."""
    drawn = training_episodes("standard", pace, DRAWN, SEED, without(BASELINE, clutch))
    laws = best_law(f"without-{clutch}", pace), find_policy(SCALED)
    return min(laws, key=lambda law: assess([law], drawn).value)


def score(results: Annotated[Path, tyro.conf.Positional], episodes: int | None = None) -> None:
    """Run policies where a clutch is dead, or is called so."""
    folder = ResultsFolder(results)
    folder.make()
    for pace in PACES:
        usual = find_episodes("standard", pace, SEED)
        usual = usual if episodes is None else usual.first(episodes)
        for clutch in CLUTCHES:
            left, dead = without(BASELINE, clutch), Failure(clutch=clutch, torque=0.0)
            failing = usual.with_task(failures=(dead,))
            told = replace(failing, nominal=left)
            runs: list[tuple[str, AnyPolicy, Episodes]] = [
                ("best law", best_without(clutch, pace), told)
            ]
            for name in POLICIES:
                policy, watching = find_policy(name), find_policy(name + DETECTOR)
                runs += [(f"{name}, told", policy, told), (name + DETECTOR, watching, failing)]
                runs += [(name, policy, replace(usual, nominal=left))]
            for name, policy, some in runs:
                failures = some.tasks[0].failures
                what = "dead" if failures else "called dead"
                run = ScenarioRun(
                    f"standard, clutch {clutch} {what}",
                    pace,
                    name,
                    0,
                    SEED,
                    some.strata,
                    evaluate(policy, some),
                    origin=origin_of(policy, some),
                    failures=failures,
                )
                folder.add([run])
                error = 1e3 * run.scores["path_error_m"].mean()
                arrive = 100.0 * run.scores["completed"].mean()
                print(f"{run.scenario}, {pace}, {name}: {error:.1f} mm, {arrive:.0f} %", flush=True)


def named(policy: str, episodes: Episodes) -> Iterator[tuple[int, float]]:
    """Yield the first clutch that is named in each episode, 0 for none, and when [s]."""
    period = episodes.tasks[0].control_period
    detector = FailureDetector(episodes.nominal, period)
    for chunk in episodes.chunks:
        memory, clutch = detector.start(len(chunk)), np.zeros(len(chunk), int)
        when = np.full(len(chunk), np.nan)
        rows = run_episodes(find_policy(policy, episodes.scenario), chunk, sensors="torque")
        for step, (telemetry, obs) in enumerate(rows):
            verdict = detector.look(obs, memory)
            first = (verdict > 0) & (clutch == 0) & np.isfinite(telemetry[:, 0])
            clutch[first], when[first] = verdict[first], step * period
        yield from zip(clutch.tolist(), when.tolist(), strict=True)


def detector(
    policies: tuple[str, ...] = POLICIES,
    scenarios: tuple[str, ...] = ("standard", "everything"),
    pace: str = "medium",
    healthy: int = 1000,
    failing: int = 100,
    seed: int = 20_000,
) -> None:
    """Print a table of training episodes: share named, wrongly, and time to the first name.

    Policies are not told of the failure, which is there from the start; `everything` has other
    clutches and arms than the detector knows, friction drift, and sensors with noise and delay.

    Args:
        policies: Names of policies.
        scenarios: Names of scenarios.
        pace: Name of the pace.
        healthy: Episodes without a failure.
        failing: Episodes with each failure.
        seed: Of the episodes.
    """
    print("policy | scenario | what fails | named right [%] | wrong [%] | median [s] | worst [s]")
    for policy, scenario in ((one, other) for one in policies for other in scenarios):
        episodes = training_episodes(scenario, pace, max(healthy, failing), seed)
        sets = {"nothing": (0, episodes.first(healthy))}
        few = episodes[:: max(1, len(episodes) // failing)] if failing else episodes[:0]
        for title, failure in faults(episodes.nominal).items() if failing else ():
            sets[title.lstrip(", ")] = failure.clutch, few.with_task(failures=(failure,))
        for title, (right, each) in sets.items():
            pairs = np.array(list(named(policy, each)))
            clutches, times = pairs[:, 0], pairs[:, 1]
            is_right = clutches == right
            wrong = 100.0 * float(np.mean(~is_right & (clutches > 0)))
            told = times[is_right & (clutches > 0)]
            when = f"{np.median(told):.2f} | {told.max():.2f}" if len(told) else "– | –"
            share = f"{100.0 * is_right.mean():.1f} | {wrong:.2f}"
            print(f"{policy} | {scenario} | {title} | {share} | {when}", flush=True)


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"tune": tune, "score": score, "detector": detector})
