"""A checker for any ``gymnasium.vector.VectorEnv``: what of Gymnasium's contract it keeps, breaks and leaves out.

    report = check_vector_env(lambda **keywords: gymnasium.make_vec("CartPole-v1", **keywords))
    print(report)

Everything is found out from outside: by playing episodes in several copies of the environment and comparing bits.
"""

import enum
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate
from numpy.typing import NDArray

AnyVectorEnv = VectorEnv[Any, Any, Any]
Mask = NDArray[np.bool_]

START_SAMPLES = 16
"""Resets of all worlds from which the range of start observations is taken."""

STREAM_EPISODES = 12
"""Episodes whose starts are compared between adjacent seeds."""

STREAM_OVERLAP = 8
"""Starts in a row that two seeds must have in common to be taken for one stream."""


class Outcome(enum.IntEnum):
    """What a check came to; the larger, the worse."""

    OK = 0
    MISSING = 1
    FAILED = 2


@dataclass(frozen=True)
class Finding:
    """What one check came to in one autoreset mode, with a sentence about it."""

    check: str
    mode: str
    outcome: Outcome
    sentence: str

    def __str__(self) -> str:
        return f"{self.outcome.name.lower():<7}  {self.mode:<9}  {self.check:<21}  {self.sentence}"


@dataclass(frozen=True)
class Report:
    """All findings about one environment."""

    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing failed; what is missing does not count."""
        return not self.checks(Outcome.FAILED)

    def checks(self, outcome: Outcome) -> set[str]:
        """Return the names of the checks that came to an outcome in at least one mode."""
        return {finding.check for finding in self.findings if finding.outcome == outcome}

    def __str__(self) -> str:
        return "\n".join(map(str, self.findings))


def check_vector_env(
    make: Callable[..., AnyVectorEnv],
    *,
    num_envs: int = 4,
    steps: int = 300,
    seed: int = 0,
    modes: Collection[AutoresetMode] = tuple(AutoresetMode),
) -> Report:
    """Check a vector environment in the autoreset modes in which it can be made.

    Parameters
    ----------
    make
        Builds the environment: called with ``num_envs=`` and, where it takes it, ``autoreset_mode=``. Its worlds are
        alike, and some episodes end within ``steps`` steps of random actions.
    num_envs
        Number of worlds, at least 2.
    steps
        Steps that a check plays.
    seed
        Of the first world, and of the actions.
    modes
        The modes to look at; all by default.

    Returns
    -------
    Report
        One finding for each check and mode: ok, failed, or missing where the environment lacks the feature.
    """
    builds = _builds(make, num_envs)
    findings: list[Finding] = []
    for mode in [mode for mode in builds if mode in modes]:
        others = [builds[other] for other in builds if other not in (mode, AutoresetMode.SAME_STEP)]
        subject = _Subject(builds[mode], others[0] if others else None, mode, num_envs, steps, seed)
        findings += [_finding(check, subject) for check in (*_CHECKS, *_AUTORESET_CHECKS[mode])]
    return Report(tuple(findings))


class _Failed(Exception):
    """A rule is broken."""


class _Missing(Exception):
    """A feature is not there."""


@dataclass(frozen=True)
class _Subject:
    """The environment in one autoreset mode; ``other`` builds it in a mode that returns an episode's last observation.

    Attributes
    ----------
    build
        Builds the environment.
    other
        Builds it in another mode, if there is one.
    mode
        The mode asked for, or the declared one where there is no choice.
    worlds, steps, seed
        As given to ``check_vector_env``.
    """

    build: Callable[[], AnyVectorEnv]
    other: Callable[[], AnyVectorEnv] | None
    mode: AutoresetMode
    worlds: int
    steps: int
    seed: int

    def actions(self) -> list[Any]:
        """Return the random actions of all steps, the same at each call."""
        with closing(self.build()) as env:
            env.action_space.seed(self.seed)
            return [env.action_space.sample() for _ in range(self.steps)]

    def seeds(self) -> list[int]:
        """Return the seeds of the worlds."""
        return list(range(self.seed, self.seed + self.worlds))

    def first_alone(self) -> Mask:
        """Return a mask that chooses the first world."""
        return np.arange(self.worlds) == 0


_Check = Callable[[_Subject], str]


@dataclass(frozen=True)
class _Return:
    """What a step or a reset returned, and which worlds took part in it or ended."""

    env: AnyVectorEnv
    obs: Any
    infos: dict[str, Any]
    chosen: Mask
    ended: Mask
    rewards: Any = None
    terminated: Any = None
    truncated: Any = None

    def parts(self) -> tuple[Any, ...]:
        """Return all that the environment handed out."""
        return self.obs, self.rewards, self.terminated, self.truncated, self.infos

    def rows(self) -> list[Any]:
        """Return the observations, world by world."""
        return list(iterate(self.env.observation_space, self.obs))

    def world(self, world: int) -> Any:
        """Return the bits of what one world returned."""
        results = [None if part is None else part[world] for part in (self.rewards, self.terminated, self.truncated)]
        return _bits((self.rows()[world], results, _info_of(self.infos, world)))


class _Visit(NamedTuple):
    """A return in which episodes ended, and the one after it."""

    end: _Return
    after: _Return


def _builds(make: Callable[..., AnyVectorEnv], num_envs: int) -> dict[AutoresetMode, Callable[[], AnyVectorEnv]]:
    """Return builders for the modes that the environment can be asked for, or for the one that it declares."""
    builds: dict[AutoresetMode, Callable[[], AnyVectorEnv]] = {}
    for mode in AutoresetMode:
        build = partial(make, num_envs=num_envs, autoreset_mode=mode)
        with suppress(TypeError, ValueError, gymnasium.error.Error):
            build().close()
            builds[mode] = build
    if not builds:
        build = partial(make, num_envs=num_envs)
        with closing(build()) as env:
            builds[_mode(env)] = build
    return builds


def _finding(check: _Check, subject: _Subject) -> Finding:
    try:
        outcome, sentence = Outcome.OK, check(subject)
    except _Failed as failure:
        outcome, sentence = Outcome.FAILED, str(failure)
    except _Missing as lack:
        outcome, sentence = Outcome.MISSING, str(lack)
    except Exception as error:  # noqa: BLE001  (an environment under test may raise anything)
        outcome, sentence = Outcome.FAILED, f"raised {type(error).__name__}: {error}"
    return Finding(check.__name__.lstrip("_"), subject.mode.name, outcome, sentence)


def _require(condition: object, sentence: str) -> None:
    if not condition:
        raise _Failed(sentence)


def _error(call: Callable[[], object]) -> Exception | None:
    """Return what a call raises."""
    try:
        call()
    except Exception as error:  # noqa: BLE001  (an environment under test may raise anything)
        return error
    return None


def _mode(env: AnyVectorEnv) -> AutoresetMode:
    """Return the declared autoreset mode, or Gymnasium's default where there is none."""
    mode = env.metadata.get("autoreset_mode")
    return mode if isinstance(mode, AutoresetMode) else AutoresetMode.NEXT_STEP


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping)


def _parts_of(value: Any) -> list[Any] | None:
    """Return what a container holds, None for anything else."""
    if _is_mapping(value):
        return [value[key] for key in sorted(value)]
    listed = getattr(value, "dtype", None) == np.dtype(object) or issubclass(type(value), (tuple, list))
    return list(value) if listed else None


def _bits(value: Any) -> Any:
    """Return something that is equal for equal bits."""
    parts = _parts_of(value)
    if parts is not None:
        names = tuple(sorted(value)) if _is_mapping(value) else None
        return names, tuple(_bits(part) for part in parts)
    if isinstance(value, (np.ndarray, np.generic)):
        return value.dtype.str, value.shape, value.tobytes()
    return type(value).__name__, repr(value)


def _leaves(value: Any) -> Iterator[NDArray[Any]]:
    """Return all arrays within a value."""
    if isinstance(value, np.ndarray):
        yield value
    for part in _parts_of(value) or ():
        yield from _leaves(part)


def _shares(one: Any, other: Any) -> bool:
    """Tell whether an array within one value shares memory with an array within the other."""
    others = list(_leaves(other))
    return any(np.shares_memory(leaf, each) for leaf in _leaves(one) for each in others)


def _scribble(value: Any) -> None:
    """Write over all arrays within a value."""
    for leaf in _leaves(value):
        if leaf.flags.writeable and leaf.dtype.kind in "biuf":
            leaf.fill(1)


def _info_of(infos: Mapping[str, Any], world: int) -> dict[str, Any]:
    """Return what ``infos`` tells about one world, going by the masks."""
    told: dict[str, Any] = {}
    for key, value in infos.items():
        mask = infos.get(f"_{key}")
        if mask is not None and mask[world]:
            told[key] = _info_of(value, world) if _is_mapping(value) else value[world]
    return told


def _reset(env: AnyVectorEnv, seed: int | Sequence[int] | None = None, mask: Mask | None = None) -> _Return:
    arguments: dict[str, Any] = {"seed": seed, "options": None if mask is None else {"reset_mask": mask.copy()}}
    obs, infos = env.reset(**arguments)
    chosen = np.ones(env.num_envs, np.bool_) if mask is None else mask.copy()
    return _Return(env, obs, infos, chosen, ended=np.zeros(env.num_envs, np.bool_))


def _step(env: AnyVectorEnv, actions: Any) -> _Return:
    obs, rewards, terminated, truncated, infos = env.step(actions)
    ended = np.logical_or(terminated, truncated)
    return _Return(env, obs, infos, np.ones(env.num_envs, np.bool_), ended, rewards, terminated, truncated)


def _play(env: AnyVectorEnv, actions: Iterable[Any], seed: int | Sequence[int]) -> Iterator[_Return]:
    """Reset and step, and reset the worlds that ended where nobody else does; yield all that comes out."""
    yield _reset(env, seed)
    for action in actions:
        returned = _step(env, action)
        yield returned
        if _mode(env) == AutoresetMode.DISABLED and returned.ended.any():
            yield _reset(env, mask=returned.ended)


def _lives(build: Callable[[], AnyVectorEnv], actions: Sequence[Any], seed: int | Sequence[int]) -> list[list[Any]]:
    """Play, and return for each world the bits of all that it returned."""
    with closing(build()) as env:
        return _by_world(env.num_envs, _play(env, actions, seed))


def _by_world(worlds: int, returns: Iterable[_Return]) -> list[list[Any]]:
    lives: list[list[Any]] = [[] for _ in range(worlds)]
    for returned in returns:
        for world in map(int, np.flatnonzero(returned.chosen)):
            lives[world].append(returned.world(world))
    return lives


def _visits(subject: _Subject) -> list[_Visit]:
    """Play, and return what came out when episodes ended."""
    with closing(subject.build()) as env:
        returns = list(_play(env, subject.actions(), subject.seed))
    visits = [_Visit(end, after) for end, after in pairwise(returns) if end.ended.any()]
    if not visits:
        raise _Missing(f"no episode ended within {subject.steps} steps: let make shorten them")
    return visits


def _batched(env: AnyVectorEnv, rows: Sequence[Any]) -> Any:
    space = cast(Any, env.single_action_space)
    return concatenate(space, rows, create_empty_array(space, len(rows)))


def _merged(env: AnyVectorEnv, chosen: Mask, one: Any, other: Any) -> Any:
    """Return actions: those of ``one`` for the chosen worlds, of ``other`` for the rest."""
    pairs = zip(chosen, iterate(env.action_space, one), iterate(env.action_space, other), strict=True)
    return _batched(env, [first if mine else second for mine, first, second in pairs])


def _flat(row: Any) -> NDArray[np.float64]:
    leaves = [row] if _parts_of(row) is None else list(_leaves(row))
    return np.concatenate([np.ravel(leaf).astype(np.float64) for leaf in leaves])


def _start_range(subject: _Subject) -> Callable[[Any], bool]:
    """Return a function that tells whether an observation looks like that of a reset."""
    with closing(subject.build()) as env:
        first = subject.seed + 1000
        resets = [_reset(env, first + k * subject.worlds) for k in range(START_SAMPLES)]
        table = np.array([_flat(row) for returned in resets for row in returned.rows()])
    low, high = table.min(axis=0), table.max(axis=0)
    margin = (high - low) + 1e-6 * (1.0 + np.abs(high))
    return lambda row: bool(np.all(np.abs(_flat(row) - 0.5 * (low + high)) <= 0.5 * (high - low) + margin))


def _need_seed_lists(subject: _Subject) -> None:
    with closing(subject.build()) as env:
        error = _error(lambda: _reset(env, subject.seeds()))
    if error is not None:
        raise _Missing(f"reset refuses a list of seeds ({type(error).__name__})")


def _need_masks(subject: _Subject) -> None:
    """Raise _Missing if ``reset_mask`` is refused, or ignored: every world restarts, even when none is chosen."""
    nobody = np.zeros(subject.worlds, np.bool_)
    with closing(subject.build()) as env:
        _reset(env, subject.seed)
        error = _error(lambda: _reset(env, mask=subject.first_alone()))
        if error is not None:
            raise _Missing(f"reset refuses options['reset_mask'] ({type(error).__name__}: {error})")
        before = _step(env, subject.actions()[0]).rows()
        if _error(lambda: _reset(env, mask=nobody)) is not None:
            return
        after = _reset(env, mask=subject.first_alone()).rows()
    if not any(_bits(one) == _bits(two) for one, two in zip(before, after, strict=True)):
        raise _Missing("reset ignores options['reset_mask']: all worlds restart")


def _metadata(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        declared = env.metadata.get("autoreset_mode")
    _require(isinstance(declared, AutoresetMode), f"metadata['autoreset_mode'] is {declared!r}, no AutoresetMode")
    _require(declared == subject.mode, f"asked for {subject.mode}, metadata['autoreset_mode'] is {declared}")
    return f"metadata['autoreset_mode'] is {declared}"


def _spaces(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        _require(env.num_envs == subject.worlds, f"num_envs is {env.num_envs}, asked for {subject.worlds}")
        for kind in ("observation", "action"):
            single, batch = getattr(env, f"single_{kind}_space"), getattr(env, f"{kind}_space")
            fits = batch == batch_space(single, subject.worlds)
            _require(fits, f"{kind}_space is not the batch of single_{kind}_space")
    return "the spaces are batches of the single ones"


def _observations(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        for number, returned in enumerate(_play(env, subject.actions(), subject.seed)):
            space = cast(Any, env.observation_space)
            _require(space.contains(returned.obs), f"return {number} has observations outside their space")
            dtype = getattr(returned.obs, "dtype", space.dtype)
            _require(dtype == space.dtype, f"observations are {dtype}, their space is {space.dtype}")
            for row in returned.infos.get("final_obs", ()):
                inside = row is None or env.single_observation_space.contains(row)
                _require(inside, f"return {number} has a final observation outside its space")
    return "observations are inside their space"


def _results(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        for returned in _play(env, subject.actions(), subject.seed):
            if returned.rewards is not None:
                _check_array("rewards", returned.rewards, subject.worlds, "f")
                _check_array("terminated", returned.terminated, subject.worlds, "b")
                _check_array("truncated", returned.truncated, subject.worlds, "b")
    return "rewards and flags have their shape and type"


def _check_array(name: str, value: Any, worlds: int, kind: str) -> None:
    dtype, shape = getattr(value, "dtype", None), getattr(value, "shape", None)
    fits = isinstance(value, np.ndarray) and getattr(dtype, "kind", "") == kind and shape == (worlds,)
    wanted = "bools" if kind == "b" else "floats"
    _require(fits, f"{name} has dtype {dtype} and shape {shape}, and is to be an array of {worlds} {wanted}")


def _info_masks(subject: _Subject) -> str:
    keys: set[str] = set()
    with closing(subject.build()) as env:
        for returned in _play(env, subject.actions(), subject.seed):
            _check_masks(returned.infos, subject.worlds)
            keys |= {key for key in returned.infos if not key.startswith("_")}
    return f"keys with their masks: {', '.join(sorted(keys)) or 'none'}"


def _check_masks(infos: Mapping[str, Any], worlds: int) -> None:
    for key, value in infos.items():
        if key.startswith("_"):
            _require(key[1:] in infos, f"infos has {key!r} without {key[1:]!r}")
            continue
        _require(f"_{key}" in infos, f"infos has {key!r} without {'_' + key!r}")
        _check_array(f"infos['_{key}']", infos[f"_{key}"], worlds, "b")
        if _is_mapping(value):
            _check_masks(value, worlds)
        else:
            _require(len(value) == worlds, f"infos[{key!r}] holds {len(value)} entries for {worlds} worlds")


def _determinism(subject: _Subject) -> str:
    actions = subject.actions()
    first, second = (_lives(subject.build, actions, subject.seed) for _ in range(2))
    _require(first == second, "two environments with equal seeds and actions differ")
    with closing(subject.build()) as env:
        again = [_by_world(subject.worlds, _play(env, actions[:20], subject.seed)) for _ in range(2)]
    _require(again[0] == again[1], "the same environment, seeded again, differs")
    return "equal seeds and actions give equal bits"


def _aliasing_returns(subject: _Subject) -> str:
    kept: list[tuple[_Return, Any]] = []
    with closing(subject.build()) as env:
        for returned in _play(env, subject.actions(), subject.seed):
            shared = bool(kept) and _shares(returned.parts(), kept[-1][0].parts())
            _require(not shared, "two successive returns share memory")
            kept.append((returned, _bits(returned.parts())))
    for returned, bits in kept:
        _require(_bits(returned.parts()) == bits, "a later call changed what an earlier one had returned")
    return "returns share no memory and keep their values"


def _aliasing_inputs(subject: _Subject) -> str:
    given: list[Any] = []
    with closing(subject.build()) as env:
        returns = _play(env, _spoiled(subject.actions(), given), subject.seed)
        lives = _by_world(subject.worlds, _spoiled_returns(returns, given))
    clean = _lives(subject.build, subject.actions(), subject.seed)
    _require(lives == clean, "what is written to actions or returns after a call changes what comes later")
    return "what is written to actions and returns after a call goes nowhere"


def _spoiled(actions: Iterable[Any], given: list[Any]) -> Iterator[Any]:
    """Yield copies of the actions, noted in ``given``, and write over each before the next."""
    for action in actions:
        given[:] = [deepcopy(action)]
        yield given[0]
        _require(_bits(given[0]) == _bits(action), "step changed its actions")
        _scribble(given)


def _spoiled_returns(returns: Iterable[_Return], given: list[Any]) -> Iterator[_Return]:
    """Yield returns and write over each before the next."""
    for returned in returns:
        _require(not _shares(returned.parts(), given), "a return shares memory with the actions")
        yield returned
        _scribble(returned.parts())


def _seeds_list(subject: _Subject) -> str:
    _need_seed_lists(subject)
    actions = subject.actions()
    one, two = (_lives(subject.build, actions, seed) for seed in (subject.seed, subject.seeds()))
    _require(one == two, "seed=s is not seed=[s, s + 1, …]")
    return "seed=s is seed=[s, s + 1, …]"


def _seeds_order(subject: _Subject) -> str:
    _need_seed_lists(subject)
    actions, seeds = subject.actions(), subject.seeds()
    turned: list[Any] = []
    with closing(subject.build()) as env:
        for action in actions:
            rows = list(iterate(env.action_space, action))
            turned.append(_batched(env, [*rows[1:], rows[0]]))
    one = _lives(subject.build, actions, seeds)
    two = _lives(subject.build, turned, [*seeds[1:], seeds[0]])
    _require([*one[1:], one[0]] == two, "the same seeds and actions in another order give other episodes")
    return "the order of the worlds does not matter"


def _seeds_company(subject: _Subject) -> str:
    _need_seed_lists(subject)
    actions, seeds = subject.actions(), subject.seeds()
    with closing(subject.build()) as env:
        pairs = zip(actions, reversed(actions), strict=True)
        mixed = [_merged(env, subject.first_alone(), one, other) for one, other in pairs]
    one = _lives(subject.build, actions, seeds)
    two = _lives(subject.build, mixed, [seeds[0], *(seed + 1000 for seed in seeds[1:])])
    _require(one[0] == two[0], "world 0 lives other episodes when the others have other seeds and actions")
    return "a world's episodes depend on its own seed and actions alone"


def _seeds_streams(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        resets = [_reset(env, subject.seed if k == 0 else None).rows() for k in range(STREAM_EPISODES)]
    starts = [[_bits(rows[world]) for rows in resets] for world in range(subject.worlds)]
    if len({start for life in starts for start in life}) == 1:
        raise _Missing("all episodes start alike: let make draw their starts")
    for world, life in enumerate(starts):
        for other in range(world):
            _require(not _overlap(life, starts[other]), f"the seeds of worlds {other} and {world} share a stream")
    return f"{subject.worlds} adjacent seeds have {subject.worlds} streams"


def _overlap(one: list[Any], two: list[Any]) -> bool:
    """Tell whether one list runs along the other, some episodes ahead or behind."""
    lags = range(len(one) - STREAM_OVERLAP + 1)
    return any(one[lag:] == two[: len(two) - lag] or two[lag:] == one[: len(one) - lag] for lag in lags)


def _partial_reset(subject: _Subject) -> str:
    _need_masks(subject)
    actions, is_start = subject.actions(), _start_range(subject)
    with closing(subject.build()) as env, closing(subject.build()) as undisturbed:
        _reset(undisturbed, subject.seed)
        _reset(env, subject.seed)
        plain = _step(undisturbed, actions[0]).rows()
        _step(env, actions[0])
        after = _reset(env, mask=subject.first_alone())
        _require(is_start(after.rows()[0]), "a chosen world does not show a start")
        kept = [_bits(row) for row in plain[1:]] == [_bits(row) for row in after.rows()[1:]]
        _require(kept, "a world that was not chosen shows another observation")
        _same_others(subject, env, undisturbed, actions[1:])
    return "chosen worlds restart, the others stay untouched"


def _same_others(subject: _Subject, env: AnyVectorEnv, undisturbed: AnyVectorEnv, actions: Sequence[Any]) -> None:
    """Step both environments, and require that all worlds but the first go on alike."""
    for action in actions:
        one, two = _step(env, action), _step(undisturbed, action)
        for world in range(1, subject.worlds):
            _require(one.world(world) == two.world(world), "a world that was not chosen goes on differently")
        if subject.mode == AutoresetMode.DISABLED and (one.ended.any() or two.ended.any()):
            return


def _partial_reset_seeds(subject: _Subject) -> str:
    _need_masks(subject)
    _need_seed_lists(subject)
    seeds = [seed + 1000 for seed in subject.seeds()]
    with closing(subject.build()) as env, closing(subject.build()) as undisturbed:
        start = _reset(undisturbed, seeds).rows()[0]
        _reset(undisturbed, subject.seed)
        _reset(env, subject.seed)
        chosen = _reset(env, seeds, subject.first_alone()).rows()[0]
        _require(_bits(chosen) == _bits(start), "the seed of a chosen world does not decide its start")
        rows, plain = _reset(env).rows(), _reset(undisturbed).rows()
        kept = [_bits(row) for row in rows[1:]] == [_bits(row) for row in plain[1:]]
        _require(kept, "a world that was not chosen took a seed")
    return "seeds reach the chosen worlds alone"


def _partial_reset_options(subject: _Subject) -> str:
    _need_masks(subject)
    mask = subject.first_alone()
    options = {"reset_mask": mask}
    with closing(subject.build()) as env:
        _reset(env, subject.seed)
        env.reset(options=options)
    kept = options.get("reset_mask") is mask and len(options) == 1 and _bits(mask) == _bits(subject.first_alone())
    _require(kept, "reset changed the caller's options")
    return "the caller's options stay as they were"


def _partial_reset_empty(subject: _Subject) -> str:
    _need_masks(subject)
    with closing(subject.build()) as env:
        _reset(env, subject.seed)
        error = _error(lambda: _reset(env, mask=np.zeros(subject.worlds, np.bool_)))
    _require(error is not None, "a reset_mask that chooses no world is accepted")
    return f"a reset_mask that chooses no world raises {type(error).__name__}"


def _begun(subject: _Subject) -> str:
    action = subject.actions()[0]
    with closing(subject.build()) as env:
        error = _error(lambda: _step(env, action))
    _require(error is not None, "step works before the first reset")
    return f"step before the first reset raises {type(error).__name__}"


def _closed(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        _reset(env, subject.seed)
        action = subject.actions()[0]
        env.close()
        env.close()
        error = _error(lambda: _step(env, action))
    _require(error is not None, "step works after close")
    return f"step after close raises {type(error).__name__}"


def _autoreset_result(subject: _Subject) -> str:
    for end, after in _visits(subject):
        for world in np.flatnonzero(end.ended):
            _require(after.rewards[world] == 0.0, "the step that resets a world has a reward")
            _require(not after.ended[world], "the step that resets a world ends it")
    return "the step that resets a world has reward 0 and no flag"


def _autoreset_action(subject: _Subject) -> str:
    actions = subject.actions()
    ended = np.zeros(subject.worlds, np.bool_)
    _visits(subject)
    with closing(subject.build()) as env, closing(subject.build()) as other:
        _reset(env, subject.seed)
        _reset(other, subject.seed)
        for action, another in zip(actions, reversed(actions), strict=True):
            one, two = _step(env, action), _step(other, _merged(env, ended, another, action))
            for world in range(subject.worlds):
                _require(one.world(world) == two.world(world), "the step that resets a world uses its action")
            ended = one.ended
    return "the step that resets a world ignores its action"


def _autoreset_start(subject: _Subject) -> str:
    is_start = _start_range(subject)
    for end, after in _visits(subject):
        shown = end if subject.mode == AutoresetMode.SAME_STEP else after
        for world in np.flatnonzero(end.ended):
            _require(is_start(shown.rows()[world]), "after an automatic reset an observation is none of a start")
    return "an automatic reset returns an observation of a start"


def _autoreset_final_masks(subject: _Subject) -> str:
    with closing(subject.build()) as env:
        for returned in _play(env, subject.actions(), subject.seed):
            for key in ("final_obs", "final_info"):
                _check_final(key, returned.infos, returned.ended)
    if all(visit.end.ended.all() for visit in _visits(subject)):
        raise _Missing("all worlds end together, so that masks tell nothing: let make vary their episodes")
    return "final_obs and final_info are there for the worlds that ended, and for no other"


def _check_final(key: str, infos: Mapping[str, Any], ended: Mask) -> None:
    _require(key in infos or not ended.any(), f"an episode ended without {key}")
    mask = infos.get(f"_{key}", np.zeros_like(ended))
    _require(np.array_equal(mask, ended), f"the mask of {key} is not that of the worlds that ended")
    if key == "final_obs" and key in infos:
        none = [row is None for row in infos[key]]
        _require(none == [not end for end in ended], "final_obs is not None exactly for the worlds that go on")


def _autoreset_final_obs(subject: _Subject) -> str:
    """Compare the first end with that in a mode that returns the last observation as such."""
    end = _visits(subject)[0].end
    other = None if subject.other is None else _visits(replace(subject, build=subject.other))[0].end
    for world in map(int, np.flatnonzero(end.ended)):
        final = end.infos["final_obs"][world]
        _require(_bits(final) != _bits(end.rows()[world]), "final_obs is the observation of the new start")
        if other is not None:
            told = _info_of(end.infos["final_info"], world)
            fits = _bits(final) == _bits(other.rows()[world]) and _bits(told) == _bits(_info_of(other.infos, world))
            _require(fits, "final_obs or final_info differ from what another mode returns at the end")
            fits = np.array_equal(end.rewards, other.rewards) and np.array_equal(end.terminated, other.terminated)
            _require(fits, "rewards or flags differ from what another mode returns at the end")
    return "final_obs is " + ("not the new start" if other is None else "what another mode returns at the end")


def _autoreset_waits(subject: _Subject) -> str:
    """Look at what happens to an ended world without and with ``reset_mask``."""
    is_start = _start_range(subject)
    for end, after in _visits(subject):
        _require("final_obs" not in end.infos, "final_obs is there although nothing was reset")
        for world in np.flatnonzero(end.ended):
            _require(not is_start(end.rows()[world]), "a world that ended shows a start at once")
            _require(is_start(after.rows()[world]), "reset_mask does not bring back a world that ended")
    actions = subject.actions()
    with closing(subject.build()) as env:
        returns = _play(env, actions, subject.seed)
        ended = next(returned.ended for returned in returns if returned.ended.any())
        error = _error(lambda: _check_waiting(_step(env, actions[0]), ended, is_start))
    if isinstance(error, _Failed):
        raise error
    return "a world that ended waits for reset_mask"


def _check_waiting(returned: _Return, ended: Mask, is_start: Callable[[Any], bool]) -> None:
    for world in np.flatnonzero(ended):
        _require(returned.ended[world] or not is_start(returned.rows()[world]), "a world that ended restarts by itself")


_CHECKS: tuple[_Check, ...] = (
    _metadata,
    _spaces,
    _observations,
    _results,
    _info_masks,
    _determinism,
    _aliasing_returns,
    _aliasing_inputs,
    _seeds_list,
    _seeds_order,
    _seeds_company,
    _seeds_streams,
    _partial_reset,
    _partial_reset_seeds,
    _partial_reset_options,
    _partial_reset_empty,
    _begun,
    _closed,
)

_AUTORESET_CHECKS: dict[AutoresetMode, tuple[_Check, ...]] = {
    AutoresetMode.NEXT_STEP: (_autoreset_result, _autoreset_action, _autoreset_start),
    AutoresetMode.SAME_STEP: (_autoreset_start, _autoreset_final_masks, _autoreset_final_obs),
    AutoresetMode.DISABLED: (_autoreset_waits,),
}
