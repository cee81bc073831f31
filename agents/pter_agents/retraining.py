"""A trained policy once more, from what its card says: trained, exported, and both scored on fresh episodes."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pter_agents.algorithms import settings_from
from pter_agents.exporting import export_run
from pter_agents.training import RUN, Arguments, train
from pter_agents.worlds import ALL, MIXED
from pter_gym.benchmark import Leaderboard, find_policy, leaderboards, run_scenario
from pter_gym.benchmark.evaluation import fresh_seed
from pter_gym.errors import ParameterError
from pter_gym.internal.files import FilePath, find_path
from pter_gym.internal.reading import reading
from pter_gym.policies import Neural, load_policy

SUFFIX = "-again"
"""Of the name of a policy that was trained again."""


def arguments_of(about: Mapping[str, Any]) -> Arguments:
    """Return how a policy was trained, from what its card tells.

    Raises
    ------
    DataError
        If the card is of a trainer that is no longer there.
    """
    with reading("the card does not tell a training that can be repeated"):
        return Arguments(settings=settings_from(about["algorithm"], about["settings"]), **about["arguments"])


def find_trained(name: FilePath) -> Neural:
    """Return a trained policy by its name in the package, or the path of its card.

    Raises
    ------
    ParameterError
        If there is none, or it was not trained.
    """
    found = find_policy(name)
    if not isinstance(found, Neural):
        raise ParameterError(f"policy must be one that was trained, got {name!r}")
    return found


def retrain(
    shipped: Neural, out: FilePath, on_progress: Callable[[int, int], None] = lambda _done, _of: None
) -> Neural:
    """Train a policy again, and return what comes out; a run that was stopped goes on.

    Parameters
    ----------
    shipped
        The policy.
    out
        Folder for the run and the new policy; made if need be.
    on_progress
        Called with the control steps so far, and those of the whole training.

    Raises
    ------
    DataError
        If its card is of a trainer that is no longer there.
    """
    arguments, out = arguments_of(shipped.card.about), find_path("out", out)
    run, name = out / "run", shipped.card.name + SUFFIX
    train(arguments, run, resume=(run / RUN).exists(), on_progress=lambda done: on_progress(done, arguments.steps))
    export_run(run, out, name=name)
    return load_policy(name, out)


def compare(shipped: Neural, again: Neural, episodes: int | None = None) -> Sequence[Leaderboard]:
    """Return the leaderboards of a policy and of what ``retrain`` returned, on fresh episodes of its scenarios.

    Parameters
    ----------
    shipped, again
        Both.
    episodes
        How many at each pace; as many as are stored by default.
    """
    policies = {each.card.name: each for each in (shipped, again)}
    scenario = arguments_of(shipped.card.about).scenario
    boards: list[Leaderboard] = []
    for each in MIXED if scenario == ALL else (scenario,):
        boards += leaderboards(run_scenario(each, policies, episodes=episodes, fresh=fresh_seed(each, policies)))
    return boards
