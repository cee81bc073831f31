"""Score the privileged predictive controller on stored episodes: scenario, pace, count, pace weight.

    python .ci/predictive_bound.py standard brisk 10 0.02

It is guided by `single-dof-tuned` and prints both on the same episodes; it takes about 10 s for each 10 s of episodes.
"""

import sys
import time

import numpy as np

from pter_gym.benchmark.episodes import load_episodes
from pter_gym.benchmark.metrics import score
from pter_gym.benchmark.pacing import find_policy
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.benchmark.statistics import bootstrap_interval
from pter_gym.envs.batch import Batch
from pter_gym.params import BASELINE
from pter_gym.predictive import PRIVILEGED, Predictive, run_predictive
from pter_gym.tasks.path_following import T_TIME

scenario, pace, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
episodes = load_episodes(scenario, pace).first(count)
guide = find_policy("single-dof-tuned", scenario=scenario)
settings = Predictive(pace_weight=float(sys.argv[4]))
found, guided, took, decisions = [], [], 0.0, 0
for machine, task, seed in zip(episodes.machines, episodes.tasks, episodes.seeds, strict=True):
    begin = time.perf_counter()
    telemetry = run_predictive(settings, machine, task, seed, guide, time_limit(task))
    if found:  # the first one compiles
        took, decisions = took + time.perf_counter() - begin, decisions + len(telemetry) - 1
    found.append(score(telemetry, task))
    batch = Batch(machine, task, 1)
    rows = simulate(batch, guide.bind(BASELINE, batch.layout), [seed], time_limit(task))[:, 0]
    guided.append(score(rows[np.isfinite(rows[:, T_TIME])], task))
print(f"{scenario}, {pace}, {count} episodes; {settings}; {1000 * took / max(decisions, 1):.1f} ms a decision")
for name, scores in ((f"predictive ({PRIVILEGED})", found), ("single-dof-tuned", guided)):
    interval = bootstrap_interval([1000 * s.path_error_m for s in scores])
    means = {
        field: float(np.mean([getattr(s, field) for s in scores]))
        for field in ("completed", "mean_pace_error", "segment_pace_error", "saturated", "stuck", "effort")
    }
    print(f"{name}: path error {interval.value:.2f} ({interval.low:.2f} to {interval.high:.2f}) mm", means)
