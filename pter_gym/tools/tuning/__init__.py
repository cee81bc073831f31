"""Gains for controllers, searched on training draws of a scenario; evaluation episodes are never read."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.tools.tuning.gains_file import add_gains
    from pter_gym.tools.tuning.search import EPISODES, TRIALS, TunedGains, tune
    from pter_gym.tools.tuning.spaces import SPACES

__all__ = ["EPISODES", "SPACES", "TRIALS", "TunedGains", "add_gains", "tune"]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "gains_file": ["add_gains"],
        "search": ["EPISODES", "TRIALS", "TunedGains", "tune"],
        "spaces": ["SPACES"],
    },
)
