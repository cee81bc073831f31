"""Interfaces to the simulator: Gymnasium's single and vector environments, and those of other libraries.

``scenario`` has the training draws of the scenarios' ids; ``sb3`` is for Stable-Baselines3.
The names below are imported on first use.
"""

from typing import TYPE_CHECKING

from pter_gym._internal.lazy import lazy_names

if TYPE_CHECKING:
    from pter_gym._engine.batch import Batch, Returns
    from pter_gym.envs._single import PathFollowingEnv
    from pter_gym.envs._vector import PathFollowingVectorEnv, make_vector_env

__all__ = ["Batch", "PathFollowingEnv", "PathFollowingVectorEnv", "Returns", "make_vector_env"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "pter_gym._engine.batch": ("Batch", "Returns"),
        "pter_gym.envs._single": ("PathFollowingEnv",),
        "pter_gym.envs._vector": ("PathFollowingVectorEnv", "make_vector_env"),
    },
)
