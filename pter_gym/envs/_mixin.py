"""What single and vector environments share: constructor, spaces, and what a policy needs."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeGuard, Unpack, cast

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import Batch
from pter_gym._internal.checks import builtin, whole_number
from pter_gym._internal.codec import TYPE
from pter_gym._internal.files import TABLE_ENDINGS, FilePath, has_ending
from pter_gym.errors import ParameterError, nearest
from pter_gym.hands import Operator, find_hand
from pter_gym.params import Machine, find_machine
from pter_gym.params._named import nominal_machine
from pter_gym.paths import Path, find_path
from pter_gym.policies._view import View, ViewArguments, find_view
from pter_gym.scenarios import PACES, Scenario, find_scenario
from pter_gym.scenarios._suite import gains_for
from pter_gym.scenarios.paces import find_pace, name_of_pace
from pter_gym.tasks._codec import codec
from pter_gym.tasks.path_following import (
    STARTS,
    TELEMETRY,
    PathFollowing,
    RewardWeights,
    Sensors,
    Starts,
)
from pter_gym.tasks.path_following._observation import BOUND
from pter_gym.tasks.path_following._specification import find_starts, largest_error_max

if TYPE_CHECKING:
    from pter_gym.controllers import Controller
    from pter_gym.scenarios.distributions import Distribution, Draws
    from pter_gym.tasks.path_following import Failure

    Failures = Distribution[object] | Sequence[Failure | Distribution[object]]

FRAME_SKIP = 3
"""Control steps for which environments with a scenario hold an action: noise that is new at each
step then gets through the clutches' lag, so that stock algorithms explore."""

CONTEXTS = 512
"""Draws of a scenario among which episodes choose."""


class Arguments(ViewArguments, total=False):
    """Arguments of all environments, which ``PathFollowingEnv`` describes.

    Vector environments take one machine and task for all worlds, or a sequence with one for each.
    """

    machine: Machine | FilePath | Sequence[Machine | FilePath] | None
    task: PathFollowing | Sequence[PathFollowing] | None
    scenario: "str | Scenario | Draws | None"
    contexts: int
    context_seed: int
    path: Path | FilePath | None
    hand: Operator | str | None
    pace: float | str | None
    reward: RewardWeights | None
    error_max: float | None
    truncation_error: float | None
    starts: Starts | str | None
    failures: "Failures | None"
    sensors: Sensors
    observe_context: bool
    privileged: bool


class WorldsSpec(EnvSpec):
    """An EnvSpec that says which argument JSON cannot hold."""

    def to_json(self) -> str:
        """Return the spec as JSON.

        Raises
        ------
        ParameterError
            If an argument holds something that is neither plain data nor stored by this package,
            such as ``Draws`` or a path of one's own.
        """
        for name, value in self.kwargs.items():
            try:
                json.dumps(value)
            except TypeError:
                raise ParameterError(
                    f"{name} must be plain data, or of the classes of pter_gym.params, hands, "
                    f"paths and tasks, to be stored as JSON, got {value!r:.200}"
                ) from None
        return super().to_json()


class WorldsMixin:
    """Mixin of the Gymnasium environments: batch, spaces and spec.

    Attributes
    ----------
    worlds
        What the worlds are.
    batch
        The worlds.
    whose_gains
        Name of the scenario whose gains control laws have here; ``paths`` on a path of one's own.
    view
        How agents see the worlds and act.
    base
        The control law that actions correct, with its gains, or None.
    reach
        What an action of 1 adds to the base's voltage [V]; None without a base.
    history
        Control steps ago of what observations end with.
    frame_skip
        Control steps for which an action is held.
    control_period
        Time between two control steps [s].
    observation_layout
        Names, units and scales of the observation's entries.
    telemetry_layout
        Names and units of the entries of the telemetry in the info.
    """

    worlds: "Worlds"
    batch: Batch
    whose_gains: str
    view: View
    base: "Controller | None"
    reach: float | None
    history: tuple[int, ...]
    frame_skip: int
    control_period: float
    observation_layout: Layout
    telemetry_layout: Layout = TELEMETRY
    metadata: dict[str, Any]
    _spec: EnvSpec | None = None
    _from_files: dict[str, object]

    def _make_worlds(
        self,
        num_envs: int,
        render_mode: str | None,
        arguments: Arguments,
        max_episode_steps: int | None = None,
        telemetry: bool = True,
        num_threads: int = 1,
    ) -> "tuple[spaces.Box[np.float32], spaces.Box[np.float32]]":
        """Make the worlds, and return the spaces of one world's observation and action.

        Raises
        ------
        ParameterError
            If there is no such argument, a value is out of range, or there is both a scenario and
            something that it draws.
        """
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise ParameterError(
                f"render_mode must be {', '.join(modes)} or None, got {render_mode!r}"
            )
        known = Arguments.__annotations__
        for name in arguments:
            if name not in known:
                listed = (*known, *signature(type(self)).parameters)
                raise ParameterError(
                    f"{name} is not an argument of environments{nearest(name, listed)}"
                )
        given: dict[str, Any] = {name: each(_from_plain, arg) for name, arg in arguments.items()}
        self._from_files = {
            name: each(find, given[name])
            for name, find in (("path", find_path), ("machine", find_machine))
            if _has_file(given.get(name))
        }
        given |= self._from_files
        self.worlds = worlds = find_worlds(**given)
        self.whose_gains, self.view = worlds.whose_gains, worlds.view
        self.base, self.reach, self.history = self.view.base, self.view.reach, self.view.history
        self.batch = batch = worlds.batch(num_envs, max_episode_steps, telemetry, num_threads)
        self.frame_skip, self.observation_layout = batch.frame_skip, batch.layout
        self.control_period = batch.task.control_period
        rate = 1.0 / (self.frame_skip * self.control_period)
        self.metadata = {**self.metadata, "render_fps": max(1, round(rate))}
        return (
            spaces.Box(-BOUND, BOUND, (len(batch.layout),), np.float32),
            spaces.Box(batch.action_low, batch.action_high, (batch.num_actions,), np.float32),
        )

    @property
    def spec(self) -> EnvSpec | None:
        """How Gymnasium made the environment, as plain data for JSON.

        It holds machines, tasks, and what was read from files.
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None
        if spec is not None:
            parts = {item.name: getattr(spec, item.name) for item in fields(spec) if item.init}
            given = {**spec.kwargs, **self._from_files}
            parts["kwargs"] = {name: each(_to_plain, value) for name, value in given.items()}
            self._spec = WorldsSpec(**parts)

    @property
    def privileged_layout(self) -> Layout:
        """Names, units and scales of what ``info["privileged"]`` holds."""
        return self.batch.privileged_layout

    @property
    def nominal_machine(self) -> Machine:
        """The machine that laws are bound to; see ``Worlds.nominal``."""
        return self.worlds.nominal

    @property
    def scenario(self) -> Scenario:
        """The scenario that scores a policy trained here; see ``Worlds.scenario``."""
        return self.worlds.scenario

    @property
    def paces(self) -> tuple[str, ...]:
        """Names of commanded paces; see ``Worlds.paces``."""
        return self.worlds.paces


@dataclass(frozen=True, kw_only=True)
class Worlds:
    """What the worlds of an environment are, however many.

    Attributes
    ----------
    machines, tasks
        As ``Batch`` takes them.
    draws
        What these were drawn from, for episodes to draw from; None where each world has its own.
    source
        The scenario that these draws are from; None without one.
    whose_gains
        The scenario whose gains suit them.
    view
        How agents see them and act.
    privileged
        Whether infos hold what no sensor shows.
    options
        Further arguments of ``Batch``.
    """

    machines: "Machine | Sequence[Machine]"
    tasks: "PathFollowing | Sequence[PathFollowing]"
    draws: "Draws | None"
    source: Scenario | None
    whose_gains: str
    view: View
    privileged: bool
    options: Mapping[str, Any]

    @property
    def nominal(self) -> Machine:
        """The machine that laws know: the middle of the draws.

        If worlds have machines of their own, it is the paper's with their clutches and largest
        voltage; different clutches raise a ParameterError.
        """
        if self.draws is not None:
            return self.draws.middle
        machines = self.machines
        return machines if isinstance(machines, Machine) else nominal_machine({*machines})

    @property
    def scenario(self) -> Scenario:
        """The scenario that scores a policy trained here.

        That of a task has episodes that begin at rest and aren't truncated. Raises a ParameterError
        if worlds have machines or tasks of their own.
        """
        if self.source is not None:
            return self.source
        machine, task = self.machines, self.tasks
        if not isinstance(machine, Machine) or not isinstance(task, PathFollowing):
            raise ParameterError("machine and task must be one for all worlds, to be scored")
        untruncated = PathFollowing.truncation_error
        return find_scenario(
            replace(task, starts=STARTS["rest"], truncation_error=untruncated), machine
        )

    @property
    def paces(self) -> tuple[str, ...]:
        """Names of commanded paces: the one of all episodes, otherwise those of the benchmark."""
        tasks = (self.tasks,) if isinstance(self.tasks, PathFollowing) else self.tasks
        first, *others = {task.pace for task in tasks}
        return tuple(PACES) if others else (name_of_pace(first),)

    def batch(
        self, num_worlds: int, max_episode_steps: int | None, telemetry: bool, num_threads: int
    ) -> Batch:
        """Return so many worlds, whose episodes have at most so many steps of the environment."""
        steps = max_episode_steps
        if steps is not None:
            steps = self.view.frame_skip * whole_number("max_episode_steps", steps)
        batch: Callable[..., Batch] = partial(
            Batch, frame_skip=self.view.frame_skip, action_unit=self.view.action_unit
        )
        if self.view.looks or self.privileged:
            from pter_gym.envs._agent_batch import AgentBatch

            nominal = None if self.view.base is None else self.nominal
            batch = partial(AgentBatch, self.view, nominal, self.privileged)
        return batch(
            self.machines,
            self.tasks,
            num_worlds,
            draws=self.draws is not None,
            max_steps=steps,
            telemetry=telemetry,
            num_threads=num_threads,
            **self.options,
        )


def find_worlds(
    *,
    machine: Machine | FilePath | Sequence[Machine | FilePath] | None = None,
    task: PathFollowing | Sequence[PathFollowing] | None = None,
    scenario: "str | Scenario | Draws | None" = None,
    contexts: int | None = None,
    context_seed: int | None = None,
    path: Path | FilePath | None = None,
    hand: Operator | str | None = None,
    pace: float | str | None = None,
    reward: RewardWeights | None = None,
    error_max: float | None = None,
    truncation_error: float | None = None,
    starts: Starts | str | None = None,
    failures: "Failures | None" = None,
    sensors: Sensors = "torque",
    observe_context: bool = False,
    privileged: bool = False,
    **view: Unpack[ViewArguments],
) -> Worlds:
    """Return what the arguments of an environment describe: these are all, with their defaults."""
    fields: dict[str, Any] = {
        "path": path if path is None else find_path(path),
        "hand": hand if hand is None else find_hand(hand),
        "pace": pace if pace is None else find_pace(pace),
        "starts": starts if starts is None else find_starts(starts),
        "failures": tuple(failures) if _is_several(failures) else failures,
        "reward": reward,
        "error_max": error_max,
        "truncation_error": truncation_error,
    }
    fields = {name: value for name, value in fields.items() if value is not None}
    if task is not None and (fields or scenario is not None):
        names = ", ".join(fields or ("scenario",))
        raise ParameterError(f"{names} must not be given with a task, which has its own")
    if scenario is None:
        if contexts is not None or context_seed is not None:
            raise ParameterError("contexts and context_seed must be given with a scenario")
        machines, draws, source = each(find_machine, machine), None, None
        tasks = _task_with(fields) if task is None else task
        whose_gains = gains_for(_checked_tasks(tasks))
    else:
        if isinstance(scenario, str | Scenario):
            fields.setdefault("starts", STARTS["path"])
        one = cast("Machine | FilePath | None", machine)
        fields.pop("hand", None)
        source = find_scenario(scenario, one, fields.pop("path", None), hand=hand)
        count = whole_number("contexts", CONTEXTS if contexts is None else contexts)
        seed = whole_number("context_seed", context_seed or 0, at_least=0)
        draws = source.draws.at_pace(fields.pop("pace", None)).with_task(**fields)
        machines, tasks = zip(*draws.pairs(count, seed), strict=True)
        whose_gains = source.whose_gains
    first = machines if isinstance(machines, Machine) else machines[0]
    usual = 1 if scenario is None else FRAME_SKIP
    return Worlds(
        machines=machines,
        tasks=tasks,
        draws=draws,
        source=source,
        whose_gains=whose_gains,
        view=find_view(whose_gains, usual, first.clutch.voltage_max, **view),
        privileged=privileged,
        options={"sensors": sensors, "observe_context": observe_context},
    )


def _task_with(fields: dict[str, Any]) -> PathFollowing:
    """Return a task, whose workspace about a path is at most as wide as its curvature allows."""
    if "path" in fields:
        widest = min(PathFollowing.error_max, largest_error_max(fields["path"]))
        fields.setdefault("error_max", widest)
    return PathFollowing(**fields)


def _checked_tasks(task: Any) -> list[PathFollowing]:
    """Return one task or several as a list, or raise a ParameterError if there is another thing."""
    tasks: list[Any] = list(task) if _is_several(task) else [task]
    for goal in tasks:
        if not isinstance(goal, PathFollowing):
            raise ParameterError(
                "task must be a PathFollowing, or a sequence of them for many worlds, "
                f"got {goal!r:.200}"
            )
    return tasks


def each(change: Callable[[Any], Any], value: Any) -> Any:
    """Return a changed value, or a list of them for a sequence."""
    return [change(item) for item in value] if _is_several(value) else change(value)


def _is_several(value: object) -> TypeGuard[Sequence[Any]]:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _has_file(value: object) -> bool:
    """Return whether a path or a machine, or one of several, is given by a file."""
    names = value if _is_several(value) else (value,)
    return any(has_ending(name, *TABLE_ENDINGS, ".toml") for name in names)


def _to_plain(value: Any) -> Any:
    """Return a dataclass of this package, a number of NumPy's or a path as plain data."""
    try:
        return codec().to_plain(value) if is_dataclass(value) else builtin(value)
    except ParameterError:  # a user's own class
        return value


def _from_plain(value: Any) -> Any:
    """Return what ``_to_plain`` made plain data from."""
    stored = cast("dict[str, object]", value) if isinstance(value, dict) else {}
    return codec().from_plain(stored) if TYPE in stored else builtin(value)
