"""Run policies on the paper's standard test and on the evaluation episodes of the scenarios, and rank them.

``_naming`` finds policies and makes them act in an environment, ``_isolation`` runs them in processes of their own,
``_from_sb3`` accepts models of learning libraries; ``simulation`` runs episodes, and ``_evaluation`` the episodes of a
scenario; ``metrics`` declares the scores, ``statistics`` combines many, ``ranking`` decides on ranks, ``leaderboard``
shows them, and ``_results`` stores the results. ``_identity`` identifies a policy by its content, and ``_verification``
runs results again. ``_standard`` is the paper's test.

The names are imported when they are first used, so a policy can act without loading the code for scores.
"""

from typing import TYPE_CHECKING

import lazy_loader

from pter_gym.benchmark._from_sb3 import from_actions, from_sb3
from pter_gym.scenarios import PACES

if TYPE_CHECKING:
    from pter_gym.benchmark._evaluation import PerSeed, run_scenario
    from pter_gym.benchmark._examination import Assessment, Examination, examine
    from pter_gym.benchmark._isolation import Isolated
    from pter_gym.benchmark._naming import find_policy
    from pter_gym.benchmark._results import ResultsFolder
    from pter_gym.benchmark._standard import Result, Run, run_standard_test
    from pter_gym.benchmark._verification import Verdict, verify
    from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards, print_boards
    from pter_gym.benchmark.metrics import Score, score, score_episodes

__all__ = [
    "PACES",
    "Assessment",
    "Examination",
    "Isolated",
    "Leaderboard",
    "PerSeed",
    "Result",
    "ResultsFolder",
    "Run",
    "Score",
    "Verdict",
    "examine",
    "find_policy",
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

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "_evaluation": ["PerSeed", "run_scenario"],
        "_examination": ["Assessment", "Examination", "examine"],
        "_isolation": ["Isolated"],
        "leaderboard": ["Leaderboard", "leaderboards", "print_boards"],
        "metrics": ["Score", "score", "score_episodes"],
        "_naming": ["find_policy"],
        "_results": ["ResultsFolder"],
        "_standard": ["Result", "Run", "run_standard_test"],
        "_verification": ["Verdict", "verify"],
    },
)
