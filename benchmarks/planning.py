"""What planning reaches with and without the hand's sines: path errors on test episodes.

    python benchmarks/planning.py [EPISODES]

compares the best tuned law, a trained policy, and the planner of examples/predictive.py, which
corrects that law knowing the mean push alone, with the same planner that knows the hand's sines and
the state. 40 episodes of `standard` at each pace take about 8 minutes of a core;
docs/development/bounds.md has the table.
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

from predictive import HELD, HORIZON, Predictive, corrected, model, search

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym.benchmark import Episodes, evaluate, find_policy
from pter_gym.benchmark.boards import mean_scores, reason_unranked
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.intervals import mean_interval
from pter_gym.controllers import Policy, bind
from pter_gym.scenarios import PACES

SEED = 2027
"""Of the test episodes."""


class Foreseeing:
    """The planner in one episode, from a twin of its world: the exact state, and what will come."""

    def __init__(self, episode: Episodes) -> None:
        (machine,), (task,), (seed,) = episode.machines, episode.tasks, episode.seeds
        self.twin = Batch(machine, task, 1)
        self.model, _ = model(machine, task)
        self.twin.reset([seed])
        self.plan, self.step = np.zeros((HORIZON, 4)), 0

    def bind(self, machine: Any, layout: Any) -> Policy:
        self.law = bind(find_policy("single-dof-tuned"), machine, layout)
        return Policy.from_function(self.act, layout, start=self.law.start)

    def act(self, observations: Any, memory: Any) -> Any:
        if self.step % HELD == 0:
            random = np.random.default_rng(self.step)
            following = np.concatenate([self.plan[1:], self.plan[-1:]])
            now = self.twin.get_worlds(), observations[0], memory[0]
            self.plan = search(self.model, self.law, *now, following, random)
        volts = corrected(self.law, observations, memory, self.plan[:1])
        self.twin.step(volts, SKIP)
        self.step += 1
        return volts


def main(count: int) -> None:
    """Print a row for each policy and pace."""
    print("| Policy | Pace | Path error [mm] | Completed | Ranked | CPU for an episode [s] |")
    print("|---|---|---:|---:|---|---:|")
    for pace in PACES:
        episodes = find_episodes("standard", pace, SEED).first(count)
        policies: dict[str, Any] = {
            name: find_policy(name) for name in ("single-dof-tuned", "residual")
        }
        policies |= {"planner": Predictive(), "planner with foresight": None}
        for name, policy in policies.items():
            begin = time.process_time()
            if policy is None:
                alone = [episodes[k : k + 1] for k in range(count)]
                parts = [evaluate(Foreseeing(episode), episode, 1) for episode in alone]
                scores = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
            else:
                scores = evaluate(policy, episodes, 1)
            spent = (time.process_time() - begin) / count
            error = mean_interval(1e3 * scores["path_error_m"])
            ends = "" if error.low is None else f" ({error.low:.1f} – {error.high:.1f})"
            means = mean_scores(scores)
            reason = reason_unranked(scores, PACES[pace])
            print(
                f"| {name} | {pace} | {error.value:.1f}{ends} | "
                f"{100.0 * means['completed']:.0f} % | {reason or 'yes'} | {spent:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
