"""Checks of what an environment declares and returns: spaces, types, masks, equal bits, memory of its own."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from copy import deepcopy
from typing import Any, cast

from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from pter_gym.envs.checker.bits import bits_of, is_mapping, scribble, shares
from pter_gym.envs.checker.playing import Check, Return, Subject, by_world, check_array, lives_of, play, require


def _metadata(subject: Subject) -> str:
    with closing(subject.build()) as env:
        declared = env.metadata.get("autoreset_mode")
    require(isinstance(declared, AutoresetMode), f"metadata['autoreset_mode'] is {declared!r}, no AutoresetMode")
    require(declared == subject.mode, f"asked for {subject.mode}, metadata['autoreset_mode'] is {declared}")
    return f"metadata['autoreset_mode'] is {declared}"


def _spaces(subject: Subject) -> str:
    with closing(subject.build()) as env:
        require(env.num_envs == subject.worlds, f"num_envs is {env.num_envs}, asked for {subject.worlds}")
        for kind in ("observation", "action"):
            single, batch = getattr(env, f"single_{kind}_space"), getattr(env, f"{kind}_space")
            fits = batch == batch_space(single, subject.worlds)
            require(fits, f"{kind}_space is not the batch of single_{kind}_space")
    return "the spaces are batches of the single ones"


def _observations(subject: Subject) -> str:
    with closing(subject.build()) as env:
        for number, returned in enumerate(play(env, subject.actions(), subject.seed)):
            space = cast(Any, env.observation_space)
            require(space.contains(returned.obs), f"return {number} has observations outside their space")
            dtype = getattr(returned.obs, "dtype", space.dtype)
            require(dtype == space.dtype, f"observations are {dtype}, their space is {space.dtype}")
            for row in returned.infos.get("final_obs", ()):
                inside = row is None or env.single_observation_space.contains(row)
                require(inside, f"return {number} has a final observation outside its space")
    return "observations are inside their space"


def _results(subject: Subject) -> str:
    with closing(subject.build()) as env:
        for returned in play(env, subject.actions(), subject.seed):
            if returned.rewards is not None:
                check_array("rewards", returned.rewards, subject.worlds, "f")
                check_array("terminated", returned.terminated, subject.worlds, "b")
                check_array("truncated", returned.truncated, subject.worlds, "b")
    return "rewards and flags have their shape and type"


def _info_masks(subject: Subject) -> str:
    keys: set[str] = set()
    with closing(subject.build()) as env:
        for returned in play(env, subject.actions(), subject.seed):
            _check_masks(returned.infos, subject.worlds)
            keys |= {key for key in returned.infos if not key.startswith("_")}
    return f"keys with their masks: {', '.join(sorted(keys)) or 'none'}"


def _check_masks(infos: Mapping[str, Any], worlds: int) -> None:
    for key, value in infos.items():
        if key.startswith("_"):
            require(key[1:] in infos, f"infos has {key!r} without {key[1:]!r}")
            continue
        require(f"_{key}" in infos, f"infos has {key!r} without {'_' + key!r}")
        check_array(f"infos['_{key}']", infos[f"_{key}"], worlds, "b")
        if is_mapping(value):
            _check_masks(value, worlds)
        else:
            require(len(value) == worlds, f"infos[{key!r}] holds {len(value)} entries for {worlds} worlds")


def _determinism(subject: Subject) -> str:
    actions = subject.actions()
    first, second = (lives_of(subject.build, actions, subject.seed) for _ in range(2))
    require(first == second, "two environments with equal seeds and actions differ")
    with closing(subject.build()) as env:
        again = [by_world(subject.worlds, play(env, actions[:20], subject.seed)) for _ in range(2)]
    require(again[0] == again[1], "the same environment, seeded again, differs")
    return "equal seeds and actions give equal bits"


def _aliasing_returns(subject: Subject) -> str:
    kept: list[tuple[Return, Any]] = []
    with closing(subject.build()) as env:
        for returned in play(env, subject.actions(), subject.seed):
            shared = bool(kept) and shares(returned.parts(), kept[-1][0].parts())
            require(not shared, "two successive returns share memory")
            kept.append((returned, bits_of(returned.parts())))
    for returned, bits in kept:
        require(bits_of(returned.parts()) == bits, "a later call changed what an earlier one had returned")
    return "returns share no memory and keep their values"


def _aliasing_inputs(subject: Subject) -> str:
    given: list[Any] = []
    with closing(subject.build()) as env:
        returns = play(env, _spoiled(subject.actions(), given), subject.seed)
        lives = by_world(subject.worlds, _spoiled_returns(returns, given))
    clean = lives_of(subject.build, subject.actions(), subject.seed)
    require(lives == clean, "what is written to actions or returns after a call changes what comes later")
    return "what is written to actions and returns after a call goes nowhere"


def _spoiled(actions: Iterable[Any], given: list[Any]) -> Iterator[Any]:
    """Yield copies of the actions, noted in ``given``, and write over each before the next."""
    for action in actions:
        given[:] = [deepcopy(action)]
        yield given[0]
        require(bits_of(given[0]) == bits_of(action), "step changed its actions")
        scribble(given)


def _spoiled_returns(returns: Iterable[Return], given: list[Any]) -> Iterator[Return]:
    """Yield returns and write over each before the next."""
    for returned in returns:
        require(not shares(returned.parts(), given), "a return shares memory with the actions")
        yield returned
        scribble(returned.parts())


RETURNS: tuple[Check, ...] = (
    _metadata,
    _spaces,
    _observations,
    _results,
    _info_masks,
    _determinism,
    _aliasing_returns,
    _aliasing_inputs,
)
