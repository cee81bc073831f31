from . import jax as jax, sb3 as sb3
from ._single import PathFollowingEnv as PathFollowingEnv
from ._vector import PathFollowingVectorEnv as PathFollowingVectorEnv, WorldState as WorldState
