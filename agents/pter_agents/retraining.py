"""Train a policy again as its card says, and score both on fresh episodes."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pter_agents.exporting import export_run
from pter_agents.training import RUN, Arguments, arguments_from, train
from pter_agents.worlds import ALL, MIXED
from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.reading import reading
from pter_gym.benchmark import Leaderboard, examine, find_policy, leaderboards, run_scenario
from pter_gym.errors import ParameterError
from pter_gym.policies import Neural, read_policy

SUFFIX = "-again"
"""Of the name of a policy that was trained again."""

FRESH_SEED = 1
"""Seed of the fresh episodes on which policies are scored."""


def arguments_of(about: Mapping[str, Any]) -> Arguments:
    """Return how a policy was trained, according to its card.

    Raises
    ------
    DataError
        If the card does not say.
    """
    with reading("the card does not tell a training that can be repeated"):
        return arguments_from({**about["arguments"], **{name: about[name] for name in ("algorithm", "settings")}})


def find_trained(name: FilePath) -> Neural:
    """Return a trained policy by its name in the package, or the path of its card.

    Raises
    ------
    ParameterError
        If there is none by that name, or it is not a trained one.
    """
    found = find_policy(name)
    if not isinstance(found, Neural):
        raise ParameterError(f"policy must be one that was trained, got {name!r}")
    return found


def retrain(
    shipped: Neural, out: FilePath, on_progress: Callable[[int, int], None] = lambda _done, _of: None
) -> Neural:
    """Train a policy again and return the new one; an interrupted run is resumed.

    Parameters
    ----------
    shipped
        The policy.
    out
        Folder for the run and the new policy; created if needed.
    on_progress
        Called with the control steps so far and in total.

    Raises
    ------
    DataError
        If its card does not say how it was trained.
    """
    arguments, out = arguments_of(shipped.card.about), find_path("out", out)
    run, name = out / "run", shipped.card.name + SUFFIX
    train(arguments, run, resume=(run / RUN).exists(), on_progress=lambda done: on_progress(done, arguments.steps))
    export_run(run, out, name=name)
    return read_policy(name, out)


def compare(shipped: Neural, again: Neural, episodes: int | None = None) -> Sequence[Leaderboard]:
    """Return the leaderboards of both policies on fresh episodes of the scenarios that they were trained on.

    Parameters
    ----------
    shipped, again
        The first policy and the one that ``retrain`` returned.
    episodes
        Number at each pace; by default as many as are stored.
    """
    policies = {each.card.name: each for each in (shipped, again)}
    boards: list[Leaderboard] = []
    for each in scenarios_of(arguments_of(shipped.card.about)):
        boards += leaderboards(run_scenario(each, policies, episodes=episodes, seed=FRESH_SEED))
    return boards


def examine_both(shipped: Neural, again: Neural) -> Sequence[str]:
    """Return lines with the scores of both on the machine they were trained for, which leaderboards do not include."""
    arguments = arguments_of(shipped.card.about)
    policies = {each.card.name: each for each in (shipped, again)}
    return [
        f"{scenario}, {pace}: {name}: {verdict}"
        for scenario in scenarios_of(arguments)
        for pace in arguments.paces
        for name, verdict in examine(policies, scenario, pace, machine=arguments.machine).items()
        if name in policies
    ]


def scenarios_of(arguments: Arguments) -> Sequence[str]:
    """Return the names of the scenarios on which a policy was trained."""
    return MIXED if arguments.scenario == ALL else (arguments.scenario,)
