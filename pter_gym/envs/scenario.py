"""Entry points of the scenarios' ids: ``PTER/PathFollowing-v0`` on a scenario's training draws."""

from typing import Any

from pter_gym.envs.devices import make_vector_env
from pter_gym.envs.single import PathFollowingEnv
from pter_gym.scenarios import find_scenario


def make_env(
    scenario: str, pace: float | str | None = None, contexts: int = 512, context_seed: int = 0, **keywords: Any
) -> PathFollowingEnv:
    """Return the environment of a scenario.

    Parameters
    ----------
    scenario
        Its name in ``pter_gym.scenarios.SCENARIOS``.
    pace
        Commanded pace [m/s] or its name in ``PACES``; None draws it between the slowest and the fastest of them.
    contexts, context_seed
        Number of pairs of machine and task to draw from, and the seed of their list.
    **keywords
        Of ``PathFollowingEnv``.
    """
    drawn = find_scenario(scenario).randomisation(pace, contexts=contexts, seed=context_seed)
    return PathFollowingEnv(randomisation=drawn, **keywords)


def make_vec(
    num_envs: int = 1,
    *,
    scenario: str,
    pace: float | str | None = None,
    contexts: int = 512,
    context_seed: int = 0,
    **keywords: Any,
) -> Any:
    """Return many worlds of a scenario; see ``make_env`` and ``pter_gym.envs.devices.make_vector_env``."""
    drawn = find_scenario(scenario).randomisation(pace, contexts=contexts, seed=context_seed)
    return make_vector_env(num_envs, randomisation=drawn, **keywords)
