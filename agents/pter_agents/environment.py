"""The environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from stable_baselines3.common.monitor import Monitor

# the module in front of the id lets worker processes register it themselves
ENVIRONMENT_ID = "pter_gym:PTER/PathFollowing-v0"


def make_env(**options: Any) -> Monitor:
    """Make the path-following environment for training with Stable-Baselines3.

    Actions are normalised to [-1, 1] per clutch, as its algorithms expect, and the episode's return, length and
    duration are recorded by its ``Monitor``.

    Parameters
    ----------
    **options
        Passed to ``gymnasium.make``: ``machine``, ``sensors``, ``config``, ``render_mode`` and so on.

    Raises
    ------
    ImportError
        If Stable-Baselines3 is not installed.
    """
    try:
        from stable_baselines3.common.monitor import Monitor
    except ModuleNotFoundError as error:
        raise ImportError('training needs Stable-Baselines3: pip install "pter-gym[agents]"') from error
    return Monitor(gymnasium.make(ENVIRONMENT_ID, action_unit="normalised", **options))
