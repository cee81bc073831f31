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

import gymnasium
import lazy_loader

from pter_gym.scenarios._suite import SCENARIOS

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
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
