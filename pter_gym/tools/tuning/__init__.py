"""Gains for controllers, searched on training draws of a scenario; evaluation episodes are never read."""

from typing import TYPE_CHECKING

from pter_gym._internal.lazy import lazy_names

if TYPE_CHECKING:
    from pter_gym.tools.tuning.search import EPISODES, TRIALS, TunedGains, tune
    from pter_gym.tools.tuning.shipping import add_gains
    from pter_gym.tools.tuning.spaces import SPACES

__all__ = ["EPISODES", "SPACES", "TRIALS", "TunedGains", "add_gains", "tune"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "pter_gym.tools.tuning.search": (
            "EPISODES",
            "TRIALS",
            "TunedGains",
            "tune",
        ),
        "pter_gym.tools.tuning.shipping": ("add_gains",),
        "pter_gym.tools.tuning.spaces": ("SPACES",),
    },
)
