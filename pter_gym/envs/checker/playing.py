"""What the checks share: the environment under check, episodes played in it, and how a check fails."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, cast

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

from pter_gym.envs.checker.bits import bits_of, info_of

AnyVectorEnv = VectorEnv[Any, Any, Any]

Mask = NDArray[np.bool_]


class Failed(Exception):
    """A rule is broken."""


class Missing(Exception):
    """A feature is not there."""


@dataclass(frozen=True)
class Subject:
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


Check = Callable[[Subject], str]


@dataclass(frozen=True)
class Return:
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
        return bits_of((self.rows()[world], results, info_of(self.infos, world)))


class Visit(NamedTuple):
    """A return in which episodes ended, and the one after it."""

    end: Return
    after: Return


def require(condition: object, sentence: str) -> None:
    """Raise Failed with a sentence where a rule does not hold."""
    if not condition:
        raise Failed(sentence)


def error_of(call: Callable[[], object]) -> Exception | None:
    """Return what a call raises."""
    try:
        call()
    except Exception as error:  # noqa: BLE001  (an environment under test may raise anything)
        return error
    return None


def mode_of(env: AnyVectorEnv) -> AutoresetMode:
    """Return the declared autoreset mode, or Gymnasium's default where there is none."""
    mode = env.metadata.get("autoreset_mode")
    return mode if isinstance(mode, AutoresetMode) else AutoresetMode.NEXT_STEP


def reset(env: AnyVectorEnv, seed: int | Sequence[int] | None = None, mask: Mask | None = None) -> Return:
    """Reset an environment, or the worlds that a mask chooses."""
    arguments: dict[str, Any] = {"seed": seed, "options": None if mask is None else {"reset_mask": mask.copy()}}
    obs, infos = env.reset(**arguments)
    chosen = np.ones(env.num_envs, np.bool_) if mask is None else mask.copy()
    return Return(env, obs, infos, chosen, ended=np.zeros(env.num_envs, np.bool_))


def step(env: AnyVectorEnv, actions: Any) -> Return:
    """Step an environment."""
    obs, rewards, terminated, truncated, infos = env.step(actions)
    ended = np.logical_or(terminated, truncated)
    return Return(env, obs, infos, np.ones(env.num_envs, np.bool_), ended, rewards, terminated, truncated)


def play(env: AnyVectorEnv, actions: Iterable[Any], seed: int | Sequence[int]) -> Iterator[Return]:
    """Reset and step, and reset the worlds that ended where nobody else does; yield all that comes out."""
    yield reset(env, seed)
    for action in actions:
        returned = step(env, action)
        yield returned
        if mode_of(env) == AutoresetMode.DISABLED and returned.ended.any():
            yield reset(env, mask=returned.ended)


def lives_of(build: Callable[[], AnyVectorEnv], actions: Sequence[Any], seed: int | Sequence[int]) -> list[list[Any]]:
    """Play, and return for each world the bits of all that it returned."""
    with closing(build()) as env:
        return by_world(env.num_envs, play(env, actions, seed))


def by_world(worlds: int, returns: Iterable[Return]) -> list[list[Any]]:
    """Return for each world the bits of all that it returned."""
    lives: list[list[Any]] = [[] for _ in range(worlds)]
    for returned in returns:
        for world in map(int, np.flatnonzero(returned.chosen)):
            lives[world].append(returned.world(world))
    return lives


def visits_of(subject: Subject) -> list[Visit]:
    """Play, and return what came out when episodes ended."""
    with closing(subject.build()) as env:
        returns = list(play(env, subject.actions(), subject.seed))
    visits = [Visit(end, after) for end, after in pairwise(returns) if end.ended.any()]
    if not visits:
        raise Missing(f"no episode ended within {subject.steps} steps: let make shorten them")
    return visits


def batched(env: AnyVectorEnv, rows: Sequence[Any]) -> Any:
    """Return the actions of all worlds as one batch."""
    space = cast(Any, env.single_action_space)
    return concatenate(space, rows, create_empty_array(space, len(rows)))


def merged(env: AnyVectorEnv, chosen: Mask, one: Any, other: Any) -> Any:
    """Return actions: those of ``one`` for the chosen worlds, of ``other`` for the rest."""
    pairs = zip(chosen, iterate(env.action_space, one), iterate(env.action_space, other), strict=True)
    return batched(env, [first if mine else second for mine, first, second in pairs])


def check_array(name: str, value: Any, worlds: int, kind: str) -> None:
    """Require an array with one number of a kind for each world: ``"f"`` floats, ``"b"`` bools."""
    dtype, shape = getattr(value, "dtype", None), getattr(value, "shape", None)
    fits = isinstance(value, np.ndarray) and getattr(dtype, "kind", "") == kind and shape == (worlds,)
    wanted = "bools" if kind == "b" else "floats"
    require(fits, f"{name} has dtype {dtype} and shape {shape}, and is to be an array of {worlds} {wanted}")
