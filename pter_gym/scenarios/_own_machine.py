"""One machine in place of those that a scenario draws: a named one, or a user's own from a preset."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar, cast

import numpy as np

from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine, is_preset, machine_of, require_kind, require_number
from pter_gym.params._preset import load_preset
from pter_gym.scenarios._suite import Scenario, Varied
from pter_gym.scenarios.randomisation import Drawn, OneOf, Vary, drawn
from pter_gym.tasks.path_following import MAX_DELAY, PathFollowing

Task = TypeVar("Task", PathFollowing, "PathFollowing | Vary[PathFollowing]")


@dataclass(frozen=True)
class OwnMachine:
    """A machine and the delay of its sensors, if known.

    Attributes
    ----------
    machine
        The machine.
    delay
        Delay from a voltage to the observation of the resulting motion [s], at least 0, rounded to control steps; None
        leaves a task's sensors unchanged.
    """

    machine: Machine
    delay: float | None = None

    def __post_init__(self) -> None:
        """Check both."""
        require_kind(self, "machine", Machine)
        if self.delay is not None:
            require_number(self, "delay", at_least=0.0)


AnyMachine = OwnMachine | Machine | str
"""A machine as users give it: itself, its name in ``MACHINES``, or the path of a preset, which has a delay."""


def find_own(machine: AnyMachine) -> OwnMachine:
    """Return a machine with its delay, which only a preset has.

    Raises
    ------
    ParameterError
        If there is no such machine, or a preset cannot be read.
    DataError
        If a preset is malformed.
    """
    if isinstance(machine, OwnMachine):
        return machine
    if isinstance(machine, str) and is_preset(machine):
        preset = load_preset(machine)
        return OwnMachine(machine_of(preset), preset.sensing.delay)
    return OwnMachine(find_machine(machine))


def on_machine(scenario: Scenario, machine: AnyMachine) -> Scenario:
    """Return a scenario with one machine for all episodes; raises like ``find_own`` and ``as_sensed``."""
    own = find_own(machine)
    varied = Varied(InPlaceOf(scenario.machine, own.machine), as_sensed(scenario.task, own))
    return replace(scenario, own=own.machine, own_varied=varied)


class InPlaceOf(Vary[Drawn]):
    """One fixed value in place of drawn ones, without changing later draws.

    Parameters
    ----------
    others
        A value or distribution.
    one
        The value.
    """

    def __init__(self, others: Any, one: Drawn) -> None:
        super().__init__(one)
        self._others = others

    def draw(self, rng: np.random.Generator) -> Drawn:
        """Return the value, after a draw of the others."""
        drawn(self._others, rng)
        return self.base

    def extremes(self) -> Sequence[Drawn]:
        """Return the value."""
        return [self.base]


def as_sensed(task: Task, own: OwnMachine) -> Task:
    """Return a task or its distribution with the delay of a machine's sensors, if known.

    Raises
    ------
    ParameterError
        If the delay is longer than a task allows.
    """
    if own.delay is None:
        return task
    period = (task.base if isinstance(task, Vary) else task).control_period
    steps = round(own.delay / period)
    if steps > MAX_DELAY:
        raise ParameterError(
            f"machine: sensing.delay must be at most {MAX_DELAY} control steps of {period:g} s, got {own.delay:g} s"
        )

    def delayed(delay: Any) -> Any:
        return InPlaceOf(delay, steps) if hasattr(delay, "draw") else steps

    return _with(task, "sensing", lambda sensing: _with(sensing, "delay", delayed))


def _with(value: Any, name: str, change: Callable[[Any], Any]) -> Any:
    """Return a dataclass or its distribution with a field, or that field's distribution, changed."""
    if isinstance(value, OneOf):
        return OneOf(tuple(_with(option, name, change) for option in value.options))
    if not isinstance(value, Vary):
        return replace(value, **{name: change(getattr(value, name))})
    varied = cast("Vary[Any]", value)
    if name not in varied.fields:
        return Vary(_with(varied.base, name, change), **varied.fields)
    return Vary(varied.base, **{**varied.fields, name: change(varied.fields[name])})
