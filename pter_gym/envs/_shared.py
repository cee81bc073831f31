"""What single and vector environments share: arguments, spaces, and what a policy needs to know."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np
from gymnasium import spaces

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import ActionUnit, Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, find_machine
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, Sensors
from pter_gym.tasks.path_following._observation import BOUND

if TYPE_CHECKING:
    from pter_gym.scenarios.randomisation import Mixture, Randomisation


class Arguments(TypedDict, total=False):
    """Arguments of all environments, which ``PathFollowingEnv`` describes.

    Vector environments take one machine and task for all worlds, or a sequence with one for each.
    """

    machine: Machine | str | Sequence[Machine | str] | None
    task: PathFollowing | Sequence[PathFollowing] | None
    sensors: Sensors
    action_unit: ActionUnit
    randomisation: "Randomisation | Mixture | None"
    observe_context: bool
    frame_skip: int


def make_batch(
    num_envs: int,
    engine: dict[str, Any],
    *,
    machine: Machine | str | Sequence[Machine | str] | None = "baseline",
    task: PathFollowing | Sequence[PathFollowing] | None = None,
    sensors: Sensors = "torque",
    action_unit: ActionUnit = "volt",
    randomisation: "Randomisation | Mixture | None" = None,
    observe_context: bool = False,
    frame_skip: int = 1,
) -> Batch:
    """Return the worlds of an environment; ``engine`` holds arguments of ``Batch`` that not all environments have.

    Raises
    ------
    ParameterError
        If a value is out of range, or a randomisation is given with a task or another machine than the default.
    """
    machines, tasks = _find_pairs(machine, task, randomisation)
    return Batch(
        machines,
        tasks,
        num_envs,
        draws=randomisation is not None,
        sensors=sensors,
        action_unit=action_unit,
        observe_context=observe_context,
        frame_skip=frame_skip,
        **engine,
    )


class Worlds:
    """What single and vector environments tell of their worlds."""

    batch: Batch

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
        """The machine of all episodes, or the paper's with their clutches and largest voltage if they have several.

        Raises
        ------
        ParameterError
            If the machines have different clutches.
        """
        return nominal_machine({machine for machine, _ in self.batch.pairs})

    def _spaces(self) -> tuple[Any, Any]:
        """Return the spaces of one world's observation and action, each a ``Box``."""
        return (
            spaces.Box(-BOUND, BOUND, (len(self.batch.layout),), np.float32),
            spaces.Box(self.batch.action_low, self.batch.action_high, (4,), np.float32),
        )

    def _frames_per_second(self) -> int:
        """Return how many steps of the environment make a second, at least 1."""
        return max(1, round(1.0 / (self.batch.frame_skip * self.batch.task.control_period)))


def nominal_machine(machines: set[Machine]) -> Machine:
    """Return the only machine, or the paper's with the clutches and the largest voltage of several."""
    if len(machines) == 1:
        return next(iter(machines))
    if len({machine.clutches for machine in machines}) > 1:
        raise ParameterError("Machine.clutches of all worlds must be the same for a policy that is bound to a machine")
    first = next(iter(machines))
    clutch = replace(BASELINE.clutch, voltage_max=first.clutch.voltage_max)
    return replace(BASELINE, clutches=first.clutches, clutch=clutch)


def _find_pairs(
    machine: Machine | str | Sequence[Machine | str] | None,
    task: PathFollowing | Sequence[PathFollowing] | None,
    randomisation: "Randomisation | Mixture | None",
) -> tuple[Machine | list[Machine], PathFollowing | Sequence[PathFollowing]]:
    """Return machines and tasks as a ``Batch`` takes them."""
    if randomisation is not None:
        if task is not None or machine not in (None, "baseline"):
            raise ParameterError("task and machine must not be given with a randomisation, which brings both")
        machines, tasks = zip(*randomisation.pairs(), strict=True)
        return list(machines), tasks
    goal: object = PathFollowing() if task is None else task
    many = isinstance(goal, Sequence) and not isinstance(goal, str)
    for each in cast(Sequence[object], goal) if many else [goal]:
        if not isinstance(each, PathFollowing):
            raise ParameterError(f"task must be a PathFollowing, or for many worlds a sequence of them, got {each!r}")
    tasks = cast("PathFollowing | Sequence[PathFollowing]", goal)
    if isinstance(machine, Sequence) and not isinstance(machine, str):
        return [find_machine(each) for each in machine], tasks
    return find_machine(machine), tasks
