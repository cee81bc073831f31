"""PTER, a passive haptic arm with four friction clutches: simulator and Gymnasium environment.

``import pter_gym`` registers the environment ids and loads nothing heavy; the rest is imported on
first use.
"""

import signal
import sys

# Ctrl-C while the command, not a program that imports the package, imports: no traceback
if (
    "".join(sys.argv[:1]).endswith(("/pter", "pter.exe"))
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from typing import TYPE_CHECKING

import gymnasium
import lazy_loader

from pter_gym._version import __version__
from pter_gym.scenarios._suite import SCENARIOS

if TYPE_CHECKING:
    from pter_gym._load_policy import load_policy
    from pter_gym._physics.open_loop import State, Trajectory, initial_state, simulate
    from pter_gym.params import (
        BASELINE,
        DELRIN_EXPERIMENTAL,
        DELRIN_THEORETICAL,
        Arm,
        Clutch,
        Hand,
        Machine,
        TorqueCurve,
    )
    from pter_gym.tasks.path_following import PathFollowing

__all__ = [
    "BASELINE",
    "DELRIN_EXPERIMENTAL",
    "DELRIN_THEORETICAL",
    "Arm",
    "Clutch",
    "Hand",
    "Machine",
    "PathFollowing",
    "State",
    "TorqueCurve",
    "Trajectory",
    "__version__",
    "initial_state",
    "load_policy",
    "simulate",
]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    [
        "benchmark",
        "controllers",
        "envs",
        "gradients",
        "haptics",
        "hands",
        "params",
        "paths",
        "policies",
        "scenarios",
        "tasks",
    ],
    submod_attrs={
        "_physics.open_loop": ["State", "Trajectory", "initial_state", "simulate"],
        "params": [
            "BASELINE",
            "DELRIN_EXPERIMENTAL",
            "DELRIN_THEORETICAL",
            "Arm",
            "Clutch",
            "Hand",
            "Machine",
            "TorqueCurve",
        ],
        "_load_policy": ["load_policy"],
        "tasks.path_following": ["PathFollowing"],
    },
)

gymnasium.register(
    id="PTER/PathFollowing-v0",
    entry_point="pter_gym.envs._single:PathFollowingEnv",
    vector_entry_point="pter_gym.envs._vector:PathFollowingVectorEnv",
    max_episode_steps=1000,
)

for _scenario in SCENARIOS.values():
    gymnasium.register(
        id=_scenario.id,
        entry_point="pter_gym.envs._single:PathFollowingEnv",
        vector_entry_point="pter_gym.envs._vector:PathFollowingVectorEnv",
        max_episode_steps=1000,
        reward_threshold=_scenario.reward_threshold,
        kwargs={"scenario": _scenario.name},
    )
