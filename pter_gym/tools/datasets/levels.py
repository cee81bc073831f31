"""The policies that act in a data set: a trained policy, stages of its training, or random actions."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark._loading import load_policy
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import unknown_name
from pter_gym.policies import read_policy

Actions = NDArray[np.float32]
Act = Callable[[NDArray[np.float32]], Actions]

STAGES = Path(__file__).parent / "stages"
"""The training whose stages act: a policy for each, and ``stages.toml``, which describes them."""

STAGES_TABLE = "stages.toml"

LEVELS = MappingProxyType(
    {
        "expert": "the trained policy of the package that is best there, without noise",
        "medium": "a policy that was trained for a part of the time, without noise",
        "replay": "the stages of a training from its start on, each with the noise with which it explored",
        "random": "actions drawn evenly from the action space",
    }
)
"""What acts in a data set, by level."""

EXPERTS = MappingProxyType({"standard": "ppo-standard"})
"""The policy that is best by the validation of its training, which is on training-side draws."""

EXPERT = "residual"
"""The same for all other scenarios."""


class Actor(NamedTuple):
    """A policy by its name; ``bind`` returns actions (N, 4) of observations, from a vector environment and a seed."""

    name: str
    bind: Callable[[PathFollowingVectorEnv, int], Act]


def actors_of(scenario: str, level: str) -> tuple[Actor, ...]:
    """Return the actors of a data set, each for the same share of its control steps.

    Raises
    ------
    ParameterError
        If there is no such level.
    """
    if level not in LEVELS:
        raise unknown_name("level", level, LEVELS)
    if level == "random":
        return (Actor("random", _bind_random),)
    if level == "expert":
        return (_trained(EXPERTS.get(scenario, EXPERT)),)
    table = stages()
    if level == "medium":
        return (_stage(table["medium"].get(scenario, table["medium"]["others"])),)
    return tuple(_stage(stage["name"], stage["deviation"], table["persistence"]) for stage in table["stages"])


def stages() -> dict[str, Any]:
    """Return the description of the training run whose stages act."""
    return tomllib.loads((STAGES / STAGES_TABLE).read_text("utf-8"))


def _trained(name: str) -> Actor:
    def bind(envs: PathFollowingVectorEnv, _: int) -> Act:
        return load_policy(name, envs)

    return Actor(name, bind)


def _bind_random(envs: PathFollowingVectorEnv, seed: int) -> Act:
    envs.action_space.seed(seed)
    return lambda _: np.asarray(envs.action_space.sample(), np.float32)


def _stage(name: str, deviation: float = 0.0, persistence: float = 0.0) -> Actor:
    """Return a stage of the training, whose normalised actions get its noise, n = ρ·n' + σ·ε with a normal ε."""
    policy = read_policy(STAGES / name)

    def bind(envs: PathFollowingVectorEnv, seed: int) -> Act:
        acting = load_policy(policy, envs)
        if deviation == 0.0:
            return acting
        rng, noise = np.random.default_rng(seed), np.zeros((envs.num_envs, 4))

        def act(obs: NDArray[np.float32]) -> Actions:
            noise[:] = persistence * noise + deviation * rng.standard_normal(noise.shape)
            return np.clip(acting(obs) + noise, -1.0, 1.0).astype(np.float32)

        return act

    return Actor(name, bind)
