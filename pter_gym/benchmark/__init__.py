"""Policies times scenarios: the paper's standard test, and the evaluation episodes of the scenarios.

``metrics`` scores episodes, ``statistics`` puts many together, ``leaderboard`` ranks policies, ``evaluation`` runs them
and ``results`` keeps what came out; ``standard`` is the paper's test.
"""

from pter_gym.benchmark.evaluation import PerSeed, run_scenario
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.metrics import Score, score, score_episodes
from pter_gym.benchmark.pacing import PACES, PerPace, find_policy
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.standard import Result, Run, find_controller, run_standard_test

__all__ = [
    "PACES",
    "Leaderboard",
    "PerPace",
    "PerSeed",
    "Result",
    "ResultsFolder",
    "Run",
    "Score",
    "find_controller",
    "find_policy",
    "leaderboards",
    "run_scenario",
    "run_standard_test",
    "score",
    "score_episodes",
]
