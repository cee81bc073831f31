"""Training episodes of the scenarios, which their environments draw."""

from functools import lru_cache
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym.envs._overrides import overrides_of_task
from pter_gym.errors import ParameterError
from pter_gym.paths import Path
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.scenarios._fixed_machine import AnyMachine
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.tasks.path_following import RewardWeights, Starts

FRAME_SKIP = 3
"""Control steps for which the environments of scenarios hold an action: noise that is new at each
decision then gets through the clutches' lag, so that stock algorithms explore."""


def training_draws(
    scenario: str,
    pace: float | str | None = None,
    contexts: int = 512,
    context_seed: int = 0,
    reward: RewardWeights | None = None,
    error_max: float | None = None,
    truncation_error: float | None = None,
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
        Commanded pace [m/s] or its name in ``PACES``; None draws it between the slowest and the
        fastest of them.
    contexts, context_seed
        Number of pairs of machine and task to draw from, and the seed of their list.
    reward
        Weights of the reward; the scenario's by default.
    error_max
        Half-width of the workspace [m], where an episode is terminated; that of the evaluation
        episodes by default.
    truncation_error
        Distance from the path [m] at which an episode is truncated, without a cost: the algorithm
        has to estimate the value of the last state. By default none is; evaluation episodes never
        are.
    starts
        How episodes begin, or its name in ``pter_gym.tasks.path_following.STARTS``: by default
        anywhere along the path, moving; with ``"rest"`` they begin like evaluation episodes, so
        exploration sees little of the path.
    machine
        One machine for all episodes, its name, or the path of a preset; by default the scenario
        draws machines.
    path
        One path for all episodes, its name in ``pter_gym.paths.PATHS``, or a CSV file of waypoints,
        where the scenario does not draw paths.

    Raises
    ------
    ParameterError
        If an argument is out of range; the message names it.
    """
    given = overrides_of_task(
        path=path,
        reward=reward,
        error_max=error_max,
        truncation_error=truncation_error,
        starts=starts,
    )
    seed = whole_number("context_seed", context_seed, at_least=0)
    found = find_scenario(scenario, machine)
    try:
        return _randomisation(found, pace, contexts=contexts, seed=seed, **given)
    except TypeError:  # unhashable, so of a wrong type: the scenario's own check names it
        return found.randomisation(pace, contexts=contexts, seed=seed, **given)


_randomisation = lru_cache(maxsize=32)(Scenario.randomisation)
"""The training draws, the same object for the same arguments, so that its pairs are drawn once."""


def find_arguments(**given: Any) -> dict[str, Any]:
    """Return arguments that name a scenario, as ``scenario`` or ``randomisation``, with what it
    draws in its place.

    Actions of a ``scenario`` are normalised and held for ``FRAME_SKIP`` control steps by default.

    Raises
    ------
    ParameterError
        If an argument is out of range, or is one that the scenario draws itself.
    """
    name = "scenario" if "scenario" in given else "randomisation"
    for other in {"task", "randomisation"} - {name} & given.keys():
        raise ParameterError(f"{other} must not be given with a {name}, which draws its own")
    known = training_draws.__annotations__.keys() & given.keys()
    arguments = {each: given.pop(each) for each in known if each != "scenario"}
    drawn = training_draws(given.pop(name), **arguments)
    held = {"action_unit": "normalised", "frame_skip": FRAME_SKIP} if name == "scenario" else {}
    return {"randomisation": drawn, **held, **given}
