"""How soon a failed clutch is named, and how often a healthy one is: python benchmarks/detector.py

Policies are not told of the failure, which is there from the start; `everything` has other clutches
and arms than the detector knows, friction drift, and sensors with noise and delay.
"""

from collections.abc import Iterator

import numpy as np
import tyro

from pter_gym.benchmark.episodes import Episodes, training_episodes
from pter_gym.benchmark.faults import faults
from pter_gym.benchmark.rollout import run_episodes
from pter_gym.controllers import FailureDetector
from pter_gym.policies.find import find_policy


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


def main(
    policies: tuple[str, ...] = ("universal", "residual", "single-dof-tuned"),
    scenarios: tuple[str, ...] = ("standard", "everything"),
    pace: str = "medium",
    healthy: int = 1000,
    failing: int = 100,
    seed: int = 20_000,
) -> None:
    """Print a table of training episodes: share named, wrongly, and time to the first name.

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
        few = episodes[:: max(1, len(episodes) // failing)]
        for title, failure in faults(episodes.nominal).items():
            sets[title.lstrip(", ")] = failure.clutch, few.with_task(failures=(failure,))
        for title, (right, each) in sets.items():
            clutches, times = map(np.array, zip(*named(policy, each), strict=True))
            is_right = clutches == right
            wrong = 100.0 * np.mean(~is_right & (clutches > 0))
            told = times[is_right & (clutches > 0)]
            when = f"{np.median(told):.2f} | {told.max():.2f}" if len(told) else "– | –"
            share = f"{100.0 * is_right.mean():.1f} | {wrong:.2f}"
            print(f"{policy} | {scenario} | {title} | {share} | {when}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
