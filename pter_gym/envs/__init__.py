"""Interfaces to the simulator: Gymnasium's single and vector environments.

``sb3`` is for Stable-Baselines3, ``jax`` for JAX.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym._engine.batch import Batch, Returns
    from pter_gym._engine.world import WorldState
    from pter_gym.envs._single import PathFollowingEnv
    from pter_gym.envs._vector import PathFollowingVectorEnv

__all__ = ["Batch", "PathFollowingEnv", "PathFollowingVectorEnv", "Returns", "WorldState"]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submodules=["jax", "sb3"],
    submod_attrs={
        "_mixin": ["Batch"],
        "_single": ["PathFollowingEnv"],
        "_vector": ["PathFollowingVectorEnv", "Returns", "WorldState"],
    },
)
