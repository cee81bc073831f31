"""Policies times scenarios: the paper's standard test, and the evaluation episodes of the scenarios.

``naming`` finds policies, ``simulation`` runs episodes of them, ``evaluation`` those of a scenario; ``metrics``
declares the scores, ``statistics`` puts many together, ``ranking`` decides on ranks, ``leaderboard`` shows them, and
``results`` keeps what came out. ``standard`` is the paper's test.
"""

from pter_gym.benchmark.evaluation import PerSeed, run_scenario
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.metrics import Score, score, score_episodes
from pter_gym.benchmark.naming import find_controller, find_policy
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.standard import Result, Run, run_standard_test
from pter_gym.scenarios import PACES

__all__ = [
    "PACES",
    "Leaderboard",
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
