"""Run policies on the test episodes of the scenarios, score and rank them.

``policies``, ``episodes`` → ``rollout`` → ``measures``, ``scores`` → ``intervals`` → ``boards``:
policies act in episodes, what they did is scored, and scores become intervals and leaderboards.
``results`` runs a scenario and stores runs in a folder.

The names are imported when they are first used, so a policy can act without loading the code for
scores.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
