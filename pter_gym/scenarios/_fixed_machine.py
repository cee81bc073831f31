"""One machine in place of those that a scenario draws: a named one, or a user's own from a preset."""

from dataclasses import dataclass, replace

from pter_gym.params import (
    Checked,
    Machine,
    find_machine,
    is_preset,
    machine_of,
    require,
    require_number,
)
from pter_gym.params._preset import load_preset
from pter_gym.tasks.path_following import MAX_DELAY, PathFollowing


@dataclass(frozen=True)
class FixedMachine(Checked):
    """A machine, and its delay from a voltage to the observation of the resulting motion [s]; None if unknown."""

    machine: Machine
    delay: float | None = None

    def __post_init__(self) -> None:
        """Check both."""
        super().__post_init__()
        if self.delay is not None:
            require_number(self, "delay", at_least=0.0)


AnyMachine = FixedMachine | Machine | str
"""A machine as users give it: itself, its name in ``MACHINES``, or the path of a preset, which has a delay."""


def find_fixed_machine(machine: AnyMachine) -> FixedMachine:
    """Return a machine with its delay, which only a preset has.

    Raises
    ------
    ParameterError
        If there is no such machine, or a preset cannot be read.
    DataError
        If a preset is malformed.
    """
    if isinstance(machine, FixedMachine):
        return machine
    if isinstance(machine, str) and is_preset(machine):
        preset = load_preset(machine)
        return FixedMachine(machine_of(preset), preset.sensing["delay"])
    return FixedMachine(find_machine(machine))


def with_delay(task: PathFollowing, fixed: FixedMachine) -> PathFollowing:
    """Return a task with the delay of a machine's sensors, if known, rounded to control steps.

    Raises
    ------
    ParameterError
        If the delay is longer than a task allows.
    """
    if fixed.delay is None:
        return task
    steps, longest = round(fixed.delay / task.control_period), MAX_DELAY * task.control_period
    require(
        steps <= MAX_DELAY,
        fixed,
        "delay",
        fixed.delay,
        f"at most {longest:g} s, {MAX_DELAY} control steps",
    )
    return replace(task, sensing=replace(task.sensing, delay=steps))
