"""Interfaces to the simulator: Gymnasium's single and vector environments, and those of other libraries.

``scenario`` has the training draws of the scenarios' ids; ``sb3`` and ``rsl_rl`` are for Stable-Baselines3 and rsl-rl.
The names below are imported on first use.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym._engine.batch import Batch, Returns
    from pter_gym.envs._single import PathFollowingEnv
    from pter_gym.envs._vector import PathFollowingVectorEnv, make_vector_env

__all__ = ["Batch", "PathFollowingEnv", "PathFollowingVectorEnv", "Returns", "make_vector_env"]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "pter_gym._engine.batch": ["Batch", "Returns"],
        "_single": ["PathFollowingEnv"],
        "_vector": ["PathFollowingVectorEnv", "make_vector_env"],
    },
)
