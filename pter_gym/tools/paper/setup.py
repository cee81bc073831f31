"""Setup of the paper's experiments: three machines, one task, one controller, and the time constants."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pter_gym.controllers import TorqueFeedback
from pter_gym.hands import eq5
from pter_gym.params import Machine, paper_machines_of, require
from pter_gym.params._preset import Preset, load_preset
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing

TIME_CONSTANTS = tuple(round(0.01 * k, 2) for k in range(1, 21))
"""Time constants of the clutches in the test runs [s]. Those of the paper are lost with its figures."""

STUDY = load_preset(Path(__file__).with_name("study.toml"))
"""The numbers of the experiments, as ``pter fit`` finds them. Scenarios have those of ``presets/pter.toml``."""

PAPER_MACHINES = paper_machines_of(STUDY)
"""The three machines of Table I by name, as the experiments have them."""


def task_of(preset: Preset) -> PathFollowing:
    """Return the standard test of a preset."""
    return PathFollowing(path=Line(**preset.path), hand=eq5(preset.hand["force_max"], preset.hand["push"]))


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Machines, task and controller of the paper's experiments, and choices for what its text leaves open.

    Attributes
    ----------
    machines
        By name, the baseline first.
    task, controller
        The standard test, and the impedance controller with torque feedback.
    own_table
        Whether the controller of a Delrin machine has that machine's torque table.
    time_constants
        Of the test runs, which Figs. 7 and 8 show and Table I averages [s].
    """

    machines: Mapping[str, Machine] = field(default_factory=lambda: dict(PAPER_MACHINES))
    task: PathFollowing = field(default_factory=lambda: task_of(STUDY))
    controller: TorqueFeedback = field(default_factory=lambda: TorqueFeedback(**STUDY.controller))
    own_table: bool = False
    time_constants: tuple[float, ...] = TIME_CONSTANTS

    def __post_init__(self) -> None:
        """Check that there are machines; the parts have checked themselves."""
        require(bool(self.machines), self, "machines", self.machines, "at least one machine by name")

    @property
    def baseline(self) -> Machine:
        """The machine with the present clutches."""
        return next(iter(self.machines.values()))

    def with_gain(self, feedback: float) -> TorqueFeedback:
        """Return the controller with another gain of its torque loops [V/(N·m)]; 0 is plain impedance control."""
        return replace(self.controller, feedback=feedback)


SETUP = Setup()
"""The setup of the package's own parameters."""


def setup_of(preset: Preset) -> Setup:
    """Return the machines, the task and the controller of a preset."""
    controller = TorqueFeedback(**preset.controller)
    return Setup(machines=paper_machines_of(preset), task=task_of(preset), controller=controller)
