"""Setup of the paper's experiments: three machines, one task, one controller, and how runs are averaged."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

from pter_gym.benchmark.metrics import Score
from pter_gym.controllers import TorqueFeedback
from pter_gym.hands import MultiSineHand, eq5
from pter_gym.params import Machine, paper_machines_of, quantity, require, require_flag, require_numbers
from pter_gym.params._preset import Preset, load_preset
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing

ErrorAverage = Literal["time", "path"]

TIME_CONSTANTS = tuple(round(0.01 * k, 2) for k in range(1, 21))
"""Time constants of the clutches in the test runs [s]. Those of the paper are lost with its figures."""

STUDY = load_preset(Path(__file__).parents[1] / "study.toml")
"""The numbers of the experiments, as ``pter fit`` finds them. Scenarios have those of ``presets/pter.toml``."""

PAPER_MACHINES = paper_machines_of(STUDY)
"""The three machines of Table I by name, as the experiments have them."""


def task_of(preset: Preset) -> PathFollowing:
    """Return the standard test of a preset."""
    return PathFollowing(path=Line(**preset.path), hand=eq5(preset.hand["force_max"], preset.hand["push"]))


def controller_of(preset: Preset) -> TorqueFeedback:
    """Return the controller of a preset."""
    return TorqueFeedback(**preset.controller)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Machines, task and controller of the paper's experiments, and choices for what its text leaves open."""

    machines: Mapping[str, Machine] = quantity(
        "1", "see Machine; by name, the baseline first", default_factory=lambda: dict(PAPER_MACHINES)
    )
    task: PathFollowing = quantity("1", "see PathFollowing", default_factory=lambda: task_of(STUDY))
    controller: TorqueFeedback = quantity("1", "see TorqueFeedback", default_factory=lambda: controller_of(STUDY))
    own_table: bool = quantity(
        "1", "chosen: whether the controller of a Delrin machine has that machine's torque table", default=False
    )
    error_average: ErrorAverage = quantity("1", "chosen: average |error| over time or over the path", default="time")
    time_constants: tuple[float, ...] = quantity(
        "s", "chosen: the test runs, which Figs. 7 and 8 show and Table I averages", default=TIME_CONSTANTS
    )

    def __post_init__(self) -> None:
        """Check the choices; machines, task and controller have checked themselves."""
        require(bool(self.machines), self, "machines", self.machines, "at least one machine by name")
        require(isinstance(self.task.hand, MultiSineHand), self, "task.hand", self.task.hand, "a MultiSineHand")
        require_flag(self, "own_table")
        accepted = ", ".join(get_args(ErrorAverage))
        require(self.error_average in get_args(ErrorAverage), self, "error_average", self.error_average, accepted)
        require_numbers(self, "time_constants", "a tuple of numbers > 0")
        positive = bool(self.time_constants) and min(self.time_constants) > 0.0
        require(positive, self, "time_constants", self.time_constants, "a tuple of numbers > 0")

    @property
    def baseline(self) -> Machine:
        """The machine with the present clutches."""
        return next(iter(self.machines.values()))

    @property
    def hand(self) -> MultiSineHand:
        """The hand of the task."""
        return cast(MultiSineHand, self.task.hand)

    def with_gain(self, feedback: float) -> TorqueFeedback:
        """Return the controller with another gain of its torque loops [V/(N·m)]; 0 is plain impedance control."""
        return replace(self.controller, feedback=feedback)

    def position_error(self, score: Score) -> float:
        """Return the average position error of a run [m]."""
        return score.mean_error_m if self.error_average == "time" else score.path_average_error_m
