"""What single and vector environments share: constructor, spaces, and what a policy needs to know."""

from collections.abc import Sequence
from dataclasses import is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import ActionUnit, Batch
from pter_gym._internal.checks import whole_number
from pter_gym.envs._overrides import overrides_of_task
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, find_machine
from pter_gym.paths import Path
from pter_gym.tasks._stored import codec
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, RewardWeights, Sensors, Starts
from pter_gym.tasks.path_following._observation import BOUND

if TYPE_CHECKING:
    from pter_gym.scenarios._fixed_machine import AnyMachine
    from pter_gym.scenarios.randomisation import Mixture, Randomisation


class Arguments(TypedDict, total=False):
    """Arguments of all environments, which ``PathFollowingEnv`` describes.

    Vector environments take one machine and task for all worlds, or a sequence with one for each.
    Those after ``scenario`` belong to it; ``pter_gym.envs.scenario.training_draws`` describes them.
    """

    machine: "AnyMachine | Sequence[Machine | str] | None"
    task: PathFollowing | Sequence[PathFollowing] | None
    sensors: Sensors
    action_unit: ActionUnit
    randomisation: "Randomisation | Mixture | str | None"
    path: Path | str | None
    pace: float | str | None
    observe_context: bool
    frame_skip: int
    scenario: str
    contexts: int
    context_seed: int
    reward: RewardWeights | None
    error_max: float | None
    truncation_error: float | None
    starts: Starts | str


class Worlds:
    """One world or many, as environments have them."""

    batch: Batch
    gains: str
    """Name of the scenario whose gains control laws have here: on a path of one's own, ``paths``."""
    metadata: dict[str, Any]
    _spec: EnvSpec | None = None

    def _make_worlds(
        self, num_envs: int, render_mode: str | None, arguments: Arguments, **engine: Any
    ) -> tuple[Any, Any]:
        """Make the worlds, and return the spaces of one world's observation and action, each a
        ``Box``.

        ``engine`` holds ``max_episode_steps``, and arguments of ``Batch`` that not all environments
        have.

        Raises
        ------
        ParameterError
            If a value is out of range, or a scenario or randomisation is given with something that
            it draws.
        """
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise ParameterError(
                f"render_mode must be {', '.join(modes)} or None, got {render_mode!r}"
            )
        given: dict[str, Any] = {name: _from_plain(value) for name, value in arguments.items()}
        name = given.get("scenario", given.get("randomisation"))
        if isinstance(name, str):
            from pter_gym.envs import scenario  # imports what a fixed task doesn't need

            self.gains = scenario.find_scenario(name).gains_on(given.get("path"))
            given = scenario.find_arguments(**given)
        self.batch = _make_batch(num_envs, engine, **given)
        if not isinstance(name, str):
            paths = {task.path for _, task in self.batch.pairs}
            self.gains = "standard" if paths == {PathFollowing.path} else "paths"
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
        """How Gymnasium made the environment; machine, task and the like are plain data, which JSON keeps."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        kwargs = (
            {} if spec is None else {name: _to_plain(value) for name, value in spec.kwargs.items()}
        )
        self._spec = spec and replace(spec, kwargs=kwargs)

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
        """The machine of all episodes, or the paper's with their clutches and largest voltage if
        they have several.

        Raises
        ------
        ParameterError
            If the machines have different clutches.
        """
        return nominal_machine({machine for machine, _ in self.batch.pairs})


def nominal_machine(machines: set[Machine]) -> Machine:
    """Return the only machine, or the paper's with the clutches and the largest voltage of several."""
    first, *others = machines
    if not others:
        return first
    if any(machine.clutches != first.clutches for machine in others):
        raise ParameterError(
            "Machine.clutches of all worlds must be the same for a policy that is bound to a machine"
        )
    clutch = replace(BASELINE.clutch, voltage_max=first.clutch.voltage_max)
    return replace(BASELINE, clutches=first.clutches, clutch=clutch)


def _make_batch(
    num_envs: int,
    engine: dict[str, Any],
    *,
    machine: Any = "baseline",
    task: Any = None,
    randomisation: "Randomisation | Mixture | None" = None,
    path: Path | str | None = None,
    pace: float | str | None = None,
    frame_skip: int = 1,
    sensors: Sensors = "torque",
    action_unit: ActionUnit = "volt",
    observe_context: bool = False,
) -> Batch:
    overrides = overrides_of_task(path=path, pace=pace)
    if overrides and not (task is None and randomisation is None):
        raise ParameterError(
            "path and pace must not be given with a task or a Randomisation, which bring both"
        )
    if randomisation is not None:
        if task is not None or machine not in (None, "baseline"):
            raise ParameterError(
                "task and machine must not be given with a randomisation, which brings both"
            )
        if not hasattr(randomisation, "pairs"):
            raise ParameterError(
                f"randomisation must be a Randomisation, a Mixture or a scenario's name, got {randomisation!r:.200}"
            )
        machine, task = zip(*randomisation.pairs(), strict=True)
    else:
        machine = (
            [find_machine(each) for each in machine] if _several(machine) else find_machine(machine)
        )
        task = PathFollowing(**overrides) if task is None else task
        for each in task if _several(task) else [task]:
            if not isinstance(each, PathFollowing):
                raise ParameterError(
                    f"task must be a PathFollowing, or a sequence of them for many worlds, got {each!r}"
                )
    held = whole_number("frame_skip", frame_skip)
    limit = engine.pop("max_episode_steps", None)
    if limit is not None:
        limit = held * whole_number("max_episode_steps", limit)
    return Batch(
        machine,
        task,
        num_envs,
        draws=randomisation is not None,
        sensors=sensors,
        action_unit=action_unit,
        observe_context=observe_context,
        frame_skip=held,
        max_steps=limit,
        **engine,
    )


def _several(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _to_plain(value: Any) -> Any:
    """Return dataclasses of this package as plain data, and anything else as it is."""
    if _several(value):
        return [_to_plain(each) for each in value]
    try:
        return codec().to_plain(value) if is_dataclass(value) else value
    except ParameterError:  # a user's own class
        return value


def _from_plain(value: Any) -> Any:
    """Return what ``_to_plain`` made plain data from."""
    if isinstance(value, list):
        return [_from_plain(each) for each in cast("list[Any]", value)]
    stored = isinstance(cast("object", value), dict) and "type" in value
    return codec().from_plain(value) if stored else value
