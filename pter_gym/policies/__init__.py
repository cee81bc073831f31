"""Trained policies: safetensors files, whose networks run as compiled laws."""

from typing import TYPE_CHECKING, Any

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.policies._files import (
        SHIPPED,
        policies_in,
        read_policy,
        shipped_policies,
        write_policy,
    )
    from pter_gym.policies._interface import Input, Interface
    from pter_gym.policies._trained import TrainedPolicy

__all__ = [
    "SHIPPED",
    "Input",
    "Interface",
    "TrainedPolicy",
    "policies_in",
    "read_policy",
    "shipped_policies",
    "write_policy",
]

lazy: Any = lazy_loader
__getattr__, __dir__, _ = lazy.attach(
    __name__,
    submod_attrs={
        "_files": ["SHIPPED", "policies_in", "read_policy", "shipped_policies", "write_policy"],
        "_interface": ["Input", "Interface"],
        "_trained": ["TrainedPolicy"],
    },
)
