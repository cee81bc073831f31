"""What single and vector environments share: constructor, spaces, and what a policy needs."""

import json
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict, cast

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import ActionUnit, Batch
from pter_gym._internal.checks import builtin, whole_number
from pter_gym._internal.files import TABLE_ENDINGS, FilePath, has_ending
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, MachineSpread, find_machine
from pter_gym.params._fields import check_number
from pter_gym.paths import Path, find_path
from pter_gym.scenarios import Scenario, find_pace, find_scenario
from pter_gym.scenarios._suite import gains_for
from pter_gym.tasks._codec import codec
from pter_gym.tasks.path_following import (
    STARTS,
    TELEMETRY,
    PathFollowing,
    RewardWeights,
    Sensors,
    Starts,
    find_starts,
)
from pter_gym.tasks.path_following._observation import BOUND
from pter_gym.tasks.path_following._specification import largest_error_max

if TYPE_CHECKING:
    from pter_gym.controllers import Controller
    from pter_gym.scenarios.distributions import Draws

FRAME_SKIP = 3
"""Control steps for which environments with a scenario hold an action: noise that is new at each
step then gets through the clutches' lag, so that stock algorithms explore."""


class Arguments(TypedDict, total=False):
    """Arguments of all environments, which ``PathFollowingEnv`` describes.

    Vector environments take one machine and task for all worlds, or a sequence with one for each.
    """

    machine: Machine | FilePath | Sequence[Machine | FilePath] | None
    task: PathFollowing | Sequence[PathFollowing] | None
    scenario: "str | Scenario | Draws | None"
    contexts: int
    context_seed: int
    path: Path | FilePath | None
    pace: float | str | None
    reward: RewardWeights | None
    error_max: float | None
    truncation_error: float | None
    starts: Starts | str | None
    sensors: Sensors
    action_unit: ActionUnit | None
    observe_context: bool
    frame_skip: int | None
    base: "str | Controller | None"
    reach: float | None


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
    batch
        The worlds.
    gains
        Name of the scenario whose gains control laws have here; ``paths`` on a path of one's own.
    base
        The control law that actions correct, with its gains, or None.
    reach
        What an action of 1 adds to the base's voltage [V]; None without a base.
    """

    batch: Batch
    gains: str
    base: "Controller | None"
    reach: float | None
    _middle: Machine | None
    metadata: dict[str, Any]
    _spec: EnvSpec | None = None
    _read: dict[str, Any]

    def _make_worlds(
        self, num_envs: int, render_mode: str | None, arguments: Arguments, **engine: Any
    ) -> tuple[Any, Any]:
        """Make the worlds, and return the spaces of one world's observation and action.

        ``engine`` holds ``max_episode_steps``, and arguments of ``Batch`` that not all environments
        have.

        Raises
        ------
        ParameterError
            If a value is out of range, or there is both a scenario and something that it draws.
        """
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise ParameterError(
                f"render_mode must be {', '.join(modes)} or None, got {render_mode!r}"
            )
        plain: dict[str, Any] = {name: _from_plain(value) for name, value in arguments.items()}
        self._read = {
            name: _read(plain[name], find)
            for name, find in (("path", find_path), ("machine", find_machine))
            if _has_file(plain.get(name))
        }
        worlds = _make_batch(num_envs, engine, **{**plain, **self._read})
        self.batch, self.gains, self.base, self.reach, self._middle = worlds
        rate = 1.0 / (self.batch.frame_skip * self.batch.task.control_period)
        self.metadata = {**self.metadata, "render_fps": max(1, round(rate))}
        return (
            spaces.Box(-BOUND, BOUND, (len(self.batch.layout),), np.float32),
            spaces.Box(
                self.batch.action_low, self.batch.action_high, (self.batch.num_actions,), np.float32
            ),
        )

    @property
    def spec(self) -> EnvSpec | None:
        """How Gymnasium made the environment, as plain data for JSON.

        It holds machines, tasks, and what was read from files.
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        given = {} if spec is None else {**spec.kwargs, **self._read}
        kwargs = {name: _to_plain(value) for name, value in given.items()}
        self._spec = spec and replace(_storable(spec), kwargs=kwargs)

    @property
    def frame_skip(self) -> int:
        """Control steps for which an action is held."""
        return self.batch.frame_skip

    @property
    def observation_layout(self) -> Layout:
        """Names, units and scales of the observation's entries."""
        return self.batch.layout

    @property
    def telemetry_layout(self) -> Layout:
        """Names and units of the entries of the telemetry in the info."""
        return TELEMETRY

    @property
    def nominal_machine(self) -> Machine:
        """The machine of all episodes; of several, the paper's with their clutches and voltage.

        Of a ``MachineSpread``, the one in its middle.

        Raises
        ------
        ParameterError
            If the machines have different clutches.
        """
        return self._middle or nominal_machine({machine for machine, _ in self.batch.pairs})


def nominal_machine(machines: set[Machine]) -> Machine:
    """Return the only machine, or the paper's with clutches and largest voltage of several."""
    first, *others = machines
    if not others:
        return first
    if any(machine.clutches != first.clutches for machine in others):
        raise ParameterError(
            "Machine.clutches of all worlds must be the same for a policy bound to a machine"
        )
    clutch = replace(BASELINE.clutch, voltage_max=first.clutch.voltage_max)
    return replace(BASELINE, clutches=first.clutches, clutch=clutch)


class _Worlds(NamedTuple):
    """The worlds, the scenario whose gains suit them, a base, its reach, and a spread's middle."""

    batch: Batch
    gains: str
    base: "Controller | None"
    reach: float | None
    middle: Machine | None


def _make_batch(
    num_envs: int,
    engine: dict[str, Any],
    *,
    machine: Any = None,
    task: Any = None,
    scenario: Any = None,
    contexts: int | None = None,
    context_seed: int | None = None,
    path: Path | FilePath | None = None,
    pace: float | str | None = None,
    reward: RewardWeights | None = None,
    error_max: float | None = None,
    truncation_error: float | None = None,
    starts: Starts | str | None = None,
    sensors: Sensors = "torque",
    action_unit: ActionUnit = "normalised",
    observe_context: bool = False,
    frame_skip: int | None = None,
    base: Any = None,
    reach: float | None = None,
) -> _Worlds:
    """Return the worlds, and what they share."""
    numbers = {"reward": reward, "error_max": error_max, "truncation_error": truncation_error}
    fields: dict[str, Any] = {name: value for name, value in numbers.items() if value is not None}
    finders = (
        ("path", path, find_path),
        ("pace", pace, find_pace),
        ("starts", starts, find_starts),
    )
    fields |= {name: find(cast(Any, value)) for name, value, find in finders if value is not None}
    if task is not None and (fields or scenario is not None):
        names = ", ".join(fields or ("scenario",))
        raise ParameterError(f"{names} must not be given with a task, which has its own")
    if scenario is None:
        if contexts is not None or context_seed is not None:
            raise ParameterError("contexts and context_seed must be given with a scenario")
        machine = list(map(find_machine, machine)) if _several(machine) else find_machine(machine)
        task = _task_with(fields) if task is None else task
        gains, middle = gains_for(_checked_tasks(task)), None
    else:
        if isinstance(scenario, str | Scenario):
            fields.setdefault("starts", STARTS["path"])
        scenario = find_scenario(scenario, machine, fields.pop("path", None))
        count = whole_number("contexts", 512 if contexts is None else contexts)
        seed = whole_number("context_seed", context_seed or 0, at_least=0)
        draws = scenario.draws.at_pace(fields.pop("pace", None)).with_task(**fields)
        machine, task = zip(*draws.pairs(count, seed), strict=True)
        gains, about = scenario.whose_gains, draws.instead or draws.machine
        middle = about.machine if isinstance(about, MachineSpread) else None
        if frame_skip is None and base is None:
            frame_skip = FRAME_SKIP
    frames = 1 if frame_skip is None else whole_number("frame_skip", frame_skip)
    max_steps = engine.pop("max_episode_steps", None)
    if max_steps is not None:
        max_steps = frames * whole_number("max_episode_steps", max_steps)
    shared: dict[str, Any] = {
        "draws": scenario is not None,
        "sensors": sensors,
        "observe_context": observe_context,
        "frame_skip": frames,
        "max_steps": max_steps,
        **engine,
    }
    if base is None:
        if reach is not None:
            raise ParameterError(f"reach must not be given without a base, got {reach!r:.200}")
        batch = Batch(machine, task, num_envs, action_unit=action_unit, **shared)
        return _Worlds(batch, gains, None, None, middle)
    if action_unit != "normalised":
        raise ParameterError(
            "action_unit must be 'normalised' with a base, whose voltages an action corrects, "
            f"got {action_unit!r}"
        )
    from pter_gym.envs._base_law import REACH, CorrectedBatch, find_base_law

    base, reach = find_base_law(base, gains), REACH if reach is None else reach
    check_number("reach", reach, above=0.0)
    nominal = middle or nominal_machine(set(machine) if _several(machine) else {machine})
    batch = CorrectedBatch(base, machine, task, num_envs, nominal=nominal, reach=reach, **shared)
    return _Worlds(batch, gains, base, reach, middle)


def _task_with(fields: dict[str, Any]) -> PathFollowing:
    """Return a task, whose workspace about a path is at most as wide as its curvature allows."""
    if "path" in fields:
        widest = min(PathFollowing.error_max, largest_error_max(fields["path"]))
        fields.setdefault("error_max", widest)
    return PathFollowing(**fields)


def _checked_tasks(task: Any) -> list[PathFollowing]:
    """Return one task or several as a list, or raise a ParameterError if there is another thing."""
    tasks: list[Any] = list(task) if _several(task) else [task]
    for goal in tasks:
        if not isinstance(goal, PathFollowing):
            raise ParameterError(
                "task must be a PathFollowing, or a sequence of them for many worlds, "
                f"got {goal!r:.200}"
            )
    return tasks


def _several(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _has_file(value: Any) -> bool:
    """Return whether a path or a machine, or one of several, is given by a file."""
    names = cast("Sequence[Any]", value) if _several(value) else (value,)
    return any(has_ending(name, *TABLE_ENDINGS, ".toml") for name in names)


def _read(value: Any, find: Callable[[Any], Any]) -> Any:
    """Return a path or a machine, or several, by name or file."""
    return [*map(find, value)] if _several(value) else find(value)


def _storable(spec: EnvSpec) -> EnvSpec:
    """Return a spec as a ``WorldsSpec``."""
    return WorldsSpec(**{item.name: getattr(spec, item.name) for item in fields(spec) if item.init})


def _to_plain(value: Any) -> Any:
    """Return this package's dataclasses, NumPy's numbers and paths as plain data."""
    if _several(value):
        return [_to_plain(item) for item in value]
    try:
        return codec().to_plain(value) if is_dataclass(value) else builtin(value)
    except ParameterError:  # a user's own class
        return value


def _from_plain(value: Any) -> Any:
    """Return what ``_to_plain`` made plain data from."""
    if isinstance(value, list):
        return [_from_plain(item) for item in cast("list[Any]", value)]
    stored = isinstance(cast("object", value), dict) and "type" in value
    return codec().from_plain(value) if stored else builtin(value)
