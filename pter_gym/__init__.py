"""PTER: a passive haptic arm with four friction clutches, as a simulator and a Gymnasium environment.

``import pter_gym`` registers the environment ids and loads nothing heavy; the rest is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import gymnasium

from pter_gym._version import __version__
from pter_gym.scenarios._suite import SCENARIOS

if TYPE_CHECKING:
    from pter_gym._physics.open_loop import State, Trajectory, initial_state, simulate
    from pter_gym.benchmark._naming import load_policy
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

_HOMES = {
    **dict.fromkeys(("State", "Trajectory", "initial_state", "simulate"), "pter_gym._physics.open_loop"),
    **dict.fromkeys(
        ("BASELINE", "DELRIN_EXPERIMENTAL", "DELRIN_THEORETICAL", "Arm", "Clutch", "Hand", "Machine", "TorqueCurve"),
        "pter_gym.params",
    ),
    "load_policy": "pter_gym.benchmark._naming",
    "PathFollowing": "pter_gym.tasks.path_following",
}


gymnasium.register(
    id="PTER/PathFollowing-v0",
    entry_point="pter_gym.envs._single:PathFollowingEnv",
    vector_entry_point="pter_gym.envs._vector:make_vector_env",
    max_episode_steps=1000,
)

for _scenario in SCENARIOS.values():
    gymnasium.register(
        id=_scenario.id,
        entry_point="pter_gym.envs.scenario:make_env",
        vector_entry_point="pter_gym.envs.scenario:make_vec",
        max_episode_steps=1000,
        kwargs={"scenario": _scenario.name},
    )


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pter_gym' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
