"""Machines, task, controller and printed numbers of the paper's experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pter_gym._compiled.layout import Layout
from pter_gym._internal.codec import tuple_of
from pter_gym._internal.fields import require
from pter_gym._internal.reading import read_toml
from pter_gym.controllers import Policy, TorqueFeedback
from pter_gym.hands import eq5
from pter_gym.params import Clutch, Machine, with_friction
from pter_gym.params._files import machine_from
from pter_gym.params._named import paper_machines
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.units import from_inch_pounds

STUDY = read_toml(Path(__file__).with_name("study.toml"), "study")
"""The numbers of the experiments by section and name, found by a search:
``docs/development/calibration.md``.

Scenarios have the defaults of the classes.
"""

BREAKAWAY_SMALL_VOLTAGE = from_inch_pounds(63.5)
"""Breakaway torque of clutch 1 at the small voltage of Figs. 3 and 4 [N·m] (section III-B)."""

TIME_CONSTANT = Clutch.time_constant
"""Time constant of the clutches by their manufacturer [s] (section IV-C.3)."""

STUDY_MACHINES = paper_machines(machine_from(STUDY["machine"]), **STUDY["delrin"])
"""The three machines of Table I by name, as the experiments have them."""


STANDARD_TASK = PathFollowing(path=Line(**STUDY["path"]), hand=eq5(**STUDY["hand"]))
"""The paper's standard test."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Machines, task and controller of the paper's experiments, and what its text leaves open.

    Attributes
    ----------
    machines
        By name, the baseline first.
    task, controller
        The standard test, and the impedance controller with torque feedback.
    own_table
        Whether the controller of a Delrin machine has that machine's torque table, not the present
        clutches'.
    table_error
        Torques in that table over the real ones of the clutches that it describes: below 1 the
        controller thinks its clutches weaker than they are, and brakes too hard. The paper's table
        is "similar to" the real one.
    delrin_table
        Torques in the table of a Delrin machine's controller over those in the present clutches'.
    time_constants
        Of the test runs, which Figs. 7 and 8 show and Table I averages [s]: 20, evenly spaced up to
        the largest, as those of the paper are lost with its figures.
    """

    machines: Mapping[str, Machine] = field(default_factory=lambda: dict(STUDY_MACHINES))
    task: PathFollowing = STANDARD_TASK
    controller: TorqueFeedback = TorqueFeedback(
        **{name: tuple_of(value) for name, value in STUDY["controller"].items()}
    )
    own_table: bool = False
    table_error: float = STUDY["runs"]["table_error"]
    delrin_table: float = STUDY["runs"]["delrin_table"]
    time_constants: tuple[float, ...] = tuple(
        round(STUDY["runs"]["time_constant_max"] * k / 20, 6) for k in range(1, 21)
    )

    def __post_init__(self) -> None:
        """Check that there are machines; the parts have checked themselves."""
        require(bool(self.machines), self, "machines", "at least one machine by name")

    @property
    def baseline(self) -> Machine:
        """The machine with the present clutches."""
        return next(iter(self.machines.values()))

    def policy(self, machine: Machine, layout: Layout, feedback: float) -> Policy:
        """Return a machine's controller with a gain of its torque loops [V/(N·m)], 0 for none."""
        known = machine if self.own_table else self.baseline
        factor = self.table_error * (1.0 if machine == self.baseline else self.delrin_table)
        assumed = replace(known, clutch=with_friction(known.clutch, factor, factor))
        return replace(self.controller, feedback=feedback).bind(assumed, layout)


SETUP = Setup()
"""The shipped setup."""
