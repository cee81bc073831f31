"""Training episodes of the scenarios, which their environments draw."""

from functools import lru_cache
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.scenarios._own_machine import AnyMachine
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.tasks.path_following import STARTS, RewardWeights, Starts

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

    Raises
    ------
    ParameterError
        If an argument is out of range; the message names it.
    """
    if isinstance(starts, str) and starts not in STARTS:
        raise unknown_name("starts", starts, STARTS)
    overrides = {
        "reward": reward,
        "error_max": error_max,
        "truncation_error": truncation_error,
        "starts": STARTS[starts] if isinstance(starts, str) else starts,
    }
    given = {name: value for name, value in overrides.items() if value is not None}
    seed = whole_number("context_seed", context_seed, at_least=0)
    found = find_scenario(scenario, machine)
    try:
        return _randomisation(found, pace, contexts=contexts, seed=seed, **given)
    except TypeError:  # unhashable, so of a wrong type: the scenario's own check names it
        return found.randomisation(pace, contexts=contexts, seed=seed, **given)


_randomisation = lru_cache(maxsize=32)(Scenario.randomisation)
"""The training draws, the same object for the same arguments, so that its pairs are drawn once."""


def find_arguments(scenario: str, **given: Any) -> dict[str, Any]:
    """Return the arguments of a scenario's environment for ``PathFollowingEnv`` without a scenario.

    Raises
    ------
    ParameterError
        If an argument is out of range, or is one that the scenario draws itself.
    """
    for name in {"task", "randomisation"} & given.keys():
        raise ParameterError(f"{name} must not be given with a scenario, which draws its own")
    known = training_draws.__annotations__.keys() & given.keys()
    drawn = training_draws(scenario, **{name: given.pop(name) for name in known})
    return {"randomisation": drawn, "action_unit": "normalised", "frame_skip": FRAME_SKIP, **given}
