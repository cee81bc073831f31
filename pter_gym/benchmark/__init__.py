"""Run policies on the test episodes of the scenarios, score and rank them.

``policies``, ``episodes`` → ``rollout`` → ``measures``, ``scores`` → ``intervals`` → ``boards``:
policies act in episodes, what they did is scored, and scores become intervals and leaderboards.
``results`` runs a scenario and stores runs in a folder.

The names are imported when they are first used, so a policy can act without loading the code for
scores.
"""

from typing import TYPE_CHECKING

import lazy_loader

from pter_gym.scenarios import PACES

if TYPE_CHECKING:
    from pter_gym.benchmark.boards import Leaderboard, leaderboards, print_boards
    from pter_gym.benchmark.episodes import Episodes, training_episodes
    from pter_gym.benchmark.policies import find_policy, from_actions, from_sb3
    from pter_gym.benchmark.results import ResultsFolder, run_scenario
    from pter_gym.benchmark.rollout import Assessment, assess, evaluate, examine
    from pter_gym.benchmark.scores import ScenarioRun, Score, score, score_episodes

__all__ = [
    "PACES",
    "Assessment",
    "Episodes",
    "Leaderboard",
    "ResultsFolder",
    "ScenarioRun",
    "Score",
    "assess",
    "evaluate",
    "examine",
    "find_policy",
    "from_actions",
    "from_sb3",
    "leaderboards",
    "print_boards",
    "run_scenario",
    "score",
    "score_episodes",
    "training_episodes",
]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "boards": ["Leaderboard", "leaderboards", "print_boards"],
        "results": ["ResultsFolder", "run_scenario"],
        "episodes": ["Episodes", "training_episodes"],
        "policies": ["find_policy", "from_actions", "from_sb3"],
        "rollout": ["Assessment", "assess", "evaluate", "examine"],
        "scores": ["ScenarioRun", "Score", "score", "score_episodes"],
    },
)
