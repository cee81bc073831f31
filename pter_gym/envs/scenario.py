"""Environments of the scenarios: ``PTER/PathFollowing-v0`` on a scenario's training draws."""

from functools import lru_cache
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym.envs._shared import stated_task
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import ParameterError
from pter_gym.paths import Path
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.scenarios._own_machine import AnyMachine
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.tasks.path_following import RewardWeights, Starts

OWN = ("task", "randomisation")
"""Arguments of ``PTER/PathFollowing-v0`` that a scenario brings itself."""

FRAME_SKIP = 3
"""Control steps for which the environments of scenarios hold an action: noise that is new at each decision then gets
through the clutches' lag, so that stock algorithms explore."""

TRUNCATION_ERROR = 0.1
"""Distance from the path [m] at which a training episode is truncated, as there is nothing to learn beyond."""


def training_draws(
    scenario: str,
    pace: float | str | None = None,
    contexts: int = 512,
    context_seed: int = 0,
    reward: RewardWeights | None = None,
    error_max: float | None = None,
    truncation_error: float = TRUNCATION_ERROR,
    starts: Starts | str = "path",
    machine: AnyMachine | None = None,
    path: Path | str | None = None,
) -> Randomisation:
    """Return the distribution from which a scenario's environment draws its episodes.

    Parameters
    ----------
    scenario
        Its name in ``pter_gym.scenarios.SCENARIOS``.
    pace
        Commanded pace [m/s] or its name in ``PACES``; None draws it between the slowest and the fastest of them.
    contexts, context_seed
        Number of pairs of machine and task to draw from, and the seed of their list.
    reward
        Weights of the reward; the scenario's by default.
    error_max
        Half-width of the workspace [m], where an episode is terminated; that of the evaluation episodes by default.
    truncation_error
        Distance from the path [m] at which an episode is truncated; the algorithm has to estimate the value of the last
        state. Evaluation episodes are not truncated like this, nor are those in a narrower workspace.
    starts
        How episodes begin, or its name in ``pter_gym.tasks.path_following.STARTS``: by default anywhere along the path,
        moving; with ``"rest"`` they begin like evaluation episodes, so exploration sees little of the path.
    machine
        One machine for all episodes, its name, or the path of a preset; by default the scenario draws machines.
    path
        One path for all episodes, its name in ``pter_gym.paths.PATHS``, or a CSV file of waypoints, where the scenario
        does not draw paths.

    Raises
    ------
    ParameterError
        If an argument is out of range; the message names it.
    """
    given = stated_task(path=path, reward=reward, error_max=error_max, truncation_error=truncation_error, starts=starts)
    seed = whole_number("context_seed", context_seed, at_least=0)
    found = find_scenario(scenario, machine)
    try:
        return _randomisation(found, pace, contexts=contexts, seed=seed, **given)
    except TypeError:  # a value that has no hash and is of a wrong type
        return found.randomisation(pace, contexts=contexts, seed=seed, **given)


_randomisation = lru_cache(maxsize=32)(Scenario.randomisation)
"""The training draws, the same object for the same arguments, so that its pairs are drawn once."""


def make_env(scenario: str, **keywords: Any) -> PathFollowingEnv:
    """Return the environment of a scenario.

    Keywords are those of ``training_draws`` and of ``PathFollowingEnv``; actions are normalised and held for
    ``FRAME_SKIP`` control steps by default.
    """
    drawn, rest = _split(scenario, keywords)
    return PathFollowingEnv(randomisation=drawn, **rest)


def make_vec(num_envs: int = 1, *, scenario: str, **keywords: Any) -> PathFollowingVectorEnv:
    """Return many worlds of a scenario; see ``make_env`` and ``PathFollowingVectorEnv``."""
    drawn, rest = _split(scenario, keywords)
    return PathFollowingVectorEnv(num_envs, randomisation=drawn, **rest)


def _split(scenario: str, keywords: dict[str, Any]) -> tuple[Randomisation, dict[str, Any]]:
    """Return a scenario's draws and the remaining keywords."""
    for name in OWN:
        if name in keywords:
            raise ParameterError(
                f"{name} must not be given: {find_scenario(scenario).id} draws its own; PTER/PathFollowing-v0 takes "
                "it, and machine, path, pace, reward, error_max, truncation_error, starts change what is drawn"
            )
    known = training_draws.__annotations__.keys() & keywords.keys()
    drawn = training_draws(scenario, **{name: keywords[name] for name in known})
    rest = {name: value for name, value in keywords.items() if name not in known}
    return drawn, {"action_unit": "normalised", "frame_skip": FRAME_SKIP, **rest}


make_env.metadata = PathFollowingEnv.metadata  # pyright: ignore[reportFunctionMemberAccess]  # for rgb_array_list
