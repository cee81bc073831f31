"""What single and vector environments share: arguments, spaces, and what a policy needs to know."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypedDict, cast

import numpy as np
from gymnasium import spaces

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import ActionUnit, Batch
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import BASELINE, Machine, find_machine
from pter_gym.paths import Path, find_path
from pter_gym.scenarios import SCENARIOS, find_pace, find_scenario
from pter_gym.scenarios.randomisation import Mixture, Randomisation
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, Sensors, find_starts
from pter_gym.tasks.path_following._observation import BOUND
from pter_gym.tasks.path_following._specification import largest_error_max


class Arguments(TypedDict, total=False):
    """Arguments of all environments, which ``PathFollowingEnv`` describes.

    Vector environments take one machine and task for all worlds, or a sequence with one for each.
    """

    machine: Machine | str | Sequence[Machine | str] | None
    task: PathFollowing | Sequence[PathFollowing] | None
    sensors: Sensors
    action_unit: ActionUnit
    randomisation: Randomisation | Mixture | str | None
    path: Path | str | None
    pace: float | str | None
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
    randomisation: Randomisation | Mixture | str | None = None,
    path: Path | str | None = None,
    pace: float | str | None = None,
    observe_context: bool = False,
    frame_skip: int = 1,
) -> Batch:
    """Return the worlds of an environment; ``engine`` holds arguments of ``Batch`` that not all environments have.

    Raises
    ------
    ParameterError
        If a value is out of range, there is no machine, path, pace or scenario of a name, or what is given excludes
        each other.
    """
    machines, tasks = _find_pairs(machine, task, randomisation, stated_task(path=path, pace=pace))
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
    randomisation: Randomisation | Mixture | str | None,
    stated: dict[str, Any],
) -> tuple[Machine | list[Machine], PathFollowing | Sequence[PathFollowing]]:
    """Return machines and tasks as a ``Batch`` takes them; path and pace are ``stated``."""
    own_machine = machine not in (None, "baseline")
    if stated and (task is not None or isinstance(randomisation, Randomisation | Mixture)):
        raise ParameterError("path and pace must not be given with a task or a Randomisation, which bring both")
    if randomisation is not None:
        if task is not None or (own_machine and not isinstance(randomisation, str)):
            raise ParameterError("task and machine must not be given with a randomisation, which brings both")
        if not isinstance(randomisation, Randomisation | Mixture):
            if not isinstance(cast(object, randomisation), str) or randomisation not in SCENARIOS:
                raise unknown_name("randomisation", randomisation, SCENARIOS)
            own: Any = machine if own_machine else None
            randomisation = find_scenario(randomisation, own).randomisation(stated.pop("pace", None), **stated)
        machines, tasks = zip(*randomisation.pairs(), strict=True)
        return list(machines), tasks
    goal: object = PathFollowing(**stated) if task is None else task
    many = isinstance(goal, Sequence) and not isinstance(goal, str)
    for each in cast(Sequence[object], goal) if many else [goal]:
        if not isinstance(each, PathFollowing):
            raise ParameterError(f"task must be a PathFollowing, or for many worlds a sequence of them, got {each!r}")
    tasks = cast("PathFollowing | Sequence[PathFollowing]", goal)
    if isinstance(machine, Sequence) and not isinstance(machine, str):
        return [find_machine(each) for each in machine], tasks
    return find_machine(machine), tasks


def stated_task(**keywords: Any) -> dict[str, Any]:
    """Return the fields of a task that were given, with paths, paces and starts also by their names.

    About a path that is given without ``error_max``, the workspace is at most as wide as its curvature allows.
    """
    found = {name: value for name, value in keywords.items() if value is not None}
    known = {"path": find_path, "pace": find_pace, "starts": find_starts}
    found |= {name: find(found[name]) for name, find in known.items() if name in found}
    if "path" in found and "error_max" not in found:
        found["error_max"] = min(PathFollowing.error_max, largest_error_max(found["path"]))
    return found
