from . import jax as jax, sb3 as sb3
from ._mixin import Batch as Batch
from ._single import PathFollowingEnv as PathFollowingEnv
from ._vector import (
    PathFollowingVectorEnv as PathFollowingVectorEnv,
    Returns as Returns,
    WorldState as WorldState,
)
