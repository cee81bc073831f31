"""Policies times scenarios: the paper's standard test, and the evaluation episodes of the scenarios.

``naming`` finds policies, ``loading`` makes them act in an environment, ``isolation`` runs them in processes of their
own, ``from_sb3`` takes those of learning libraries; ``simulation`` runs episodes of them, ``evaluation`` those of a
scenario; ``metrics`` declares the scores, ``statistics`` puts many together, ``ranking`` decides on ranks,
``leaderboard`` shows them, and ``results`` keeps what came out. ``identity`` tells what a policy is, and
``verification`` runs results again. ``standard`` is the paper's test.
"""

from pter_gym.benchmark.evaluation import PerSeed, fresh_seed, run_scenario
from pter_gym.benchmark.from_sb3 import from_actions, from_sb3
from pter_gym.benchmark.isolation import Isolated
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards, print_boards
from pter_gym.benchmark.metrics import Score, score, score_episodes
from pter_gym.benchmark.naming import find_controller, find_policy, read_policy
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.standard import Result, Run, run_standard_test
from pter_gym.benchmark.verification import Verdict, verify
from pter_gym.scenarios import PACES

__all__ = [
    "PACES",
    "Isolated",
    "Leaderboard",
    "PerSeed",
    "Result",
    "ResultsFolder",
    "Run",
    "Score",
    "Verdict",
    "find_controller",
    "find_policy",
    "fresh_seed",
    "from_actions",
    "from_sb3",
    "leaderboards",
    "print_boards",
    "read_policy",
    "run_scenario",
    "run_standard_test",
    "score",
    "score_episodes",
    "verify",
]
