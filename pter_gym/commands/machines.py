"""Machines of the user's own, given by the path of a preset."""

from dataclasses import replace
from typing import TYPE_CHECKING

from pter_gym.errors import ParameterError

if TYPE_CHECKING:
    from pter_gym.tasks.path_following import PathFollowing


def as_sensed(task: "PathFollowing", machine: str) -> "PathFollowing":
    """Return a task whose observations are as late as a preset says; the task itself for a named machine."""
    from pter_gym.params import is_preset
    from pter_gym.params.preset import load_preset
    from pter_gym.tasks.path_following import MAX_DELAY

    if not is_preset(machine):
        return task
    delay = load_preset(machine).sensing.delay
    steps = round(delay / task.control_period)
    if steps > MAX_DELAY:
        raise ParameterError(
            f"machine: sensing.delay must be at most {MAX_DELAY} control steps of {task.control_period:g} s, "
            f"got {delay:g} s"
        )
    return replace(task, sensing=replace(task.sensing, delay=steps)) if steps else task
