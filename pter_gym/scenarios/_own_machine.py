"""One machine in place of those that a scenario draws: a named one, or a user's own from a preset."""

from dataclasses import dataclass, replace

from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine, is_preset, machine_of, require_kind, require_number
from pter_gym.params._preset import load_preset
from pter_gym.tasks.path_following import MAX_DELAY, PathFollowing


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
        return OwnMachine(machine_of(preset), preset.sensing["delay"])
    return OwnMachine(find_machine(machine))


def as_sensed(task: PathFollowing, own: OwnMachine) -> PathFollowing:
    """Return a task with the delay of a machine's sensors, if known.

    Raises
    ------
    ParameterError
        If the delay is longer than a task allows.
    """
    if own.delay is None:
        return task
    steps = round(own.delay / task.control_period)
    if steps > MAX_DELAY:
        raise ParameterError(
            f"machine: sensing.delay must be at most {MAX_DELAY} control steps of {task.control_period:g} s, "
            f"got {own.delay:g} s"
        )
    return replace(task, sensing=replace(task.sensing, delay=steps))
