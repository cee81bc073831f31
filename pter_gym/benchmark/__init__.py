"""Policies times scenarios: the paper's standard test, and the evaluation episodes of the scenarios.

``naming`` finds policies and makes them act in an environment, ``isolation`` runs them in processes of their own,
``from_sb3`` takes those of learning libraries; ``simulation`` runs episodes of them, ``evaluation`` those of a
scenario; ``metrics`` declares the scores, ``statistics`` combines many, ``ranking`` decides on ranks,
``leaderboard`` shows them, and ``results`` keeps what came out. ``identity`` tells what a policy is, and
``verification`` runs results again. ``standard`` is the paper's test.

The names are imported when they are first used: a policy acts without what scores need.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pter_gym.benchmark._from_sb3 import from_actions, from_sb3
from pter_gym.scenarios import PACES

if TYPE_CHECKING:
    from pter_gym.benchmark._evaluation import PerSeed, fresh_seed, run_scenario
    from pter_gym.benchmark._isolation import Isolated
    from pter_gym.benchmark._leaderboard import Leaderboard, leaderboards, print_boards
    from pter_gym.benchmark._metrics import Score, score, score_episodes
    from pter_gym.benchmark._naming import find_policy
    from pter_gym.benchmark._results import ResultsFolder
    from pter_gym.benchmark._standard import Result, Run, run_standard_test
    from pter_gym.benchmark._verification import Verdict, verify

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
    "find_policy",
    "fresh_seed",
    "from_actions",
    "from_sb3",
    "leaderboards",
    "print_boards",
    "run_scenario",
    "run_standard_test",
    "score",
    "score_episodes",
    "verify",
]

_HOMES = {
    **dict.fromkeys(("PerSeed", "fresh_seed", "run_scenario"), "evaluation"),
    "Isolated": "isolation",
    **dict.fromkeys(("Leaderboard", "leaderboards", "print_boards"), "leaderboard"),
    **dict.fromkeys(("Score", "score", "score_episodes"), "metrics"),
    "find_policy": "naming",
    "ResultsFolder": "results",
    **dict.fromkeys(("Result", "Run", "run_standard_test"), "standard"),
    **dict.fromkeys(("Verdict", "verify"), "verification"),
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pter_gym.benchmark' has no attribute {name!r}")
    value = getattr(import_module(f"pter_gym.benchmark.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
