"""All of the paper's experiments on one setup, each run when first needed."""

from dataclasses import dataclass, field
from functools import cached_property

from pter_gym.tools.paper.experiments.feedback import GainSweep, LineFollowing, gain_sweep, line_following
from pter_gym.tools.paper.experiments.holding import Holding, holding
from pter_gym.tools.paper.experiments.reversal import Reversals, reversals
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.tools.paper.experiments.single_dof import SingleDof, single_dof
from pter_gym.tools.paper.experiments.step_response import StepResponse, step_response
from pter_gym.tools.paper.experiments.time_constants import (
    Sweep,
    TableRow,
    table1,
    time_constant_sweep,
    with_equal_peaks,
)
from pter_gym.tools.paper.experiments.torque_curves import TorqueCurves, torque_curves


@dataclass(frozen=True)
class Study:
    """The paper's experiments with their default arguments on one setup.

    Attributes
    ----------
    setup
        Machines, task and controller.
    """

    setup: Setup = field(default_factory=Setup)

    @cached_property
    def single_dof(self) -> SingleDof:
        """Figs. 3 and 4."""
        return single_dof(self.setup.baseline)

    @cached_property
    def step_response(self) -> StepResponse:
        """The clutch step response of section III-B."""
        return step_response(self.setup.baseline)

    @cached_property
    def holding(self) -> Holding:
        """Static loads on four engaged clutches (section III-A)."""
        return holding(self.setup.baseline)

    @cached_property
    def torque_curves(self) -> TorqueCurves:
        """Fig. 5."""
        return torque_curves(self.setup.machines)

    @cached_property
    def sweeps(self) -> dict[str, Sweep]:
        """Figs. 7 and 8."""
        return time_constant_sweep(self.setup)

    @cached_property
    def table1(self) -> dict[str, TableRow]:
        """Table I."""
        return table1(self.sweeps)

    @cached_property
    def table1_equal_peak(self) -> dict[str, TableRow]:
        """Table I if every material reached the baseline's largest torque."""
        return table1(time_constant_sweep(with_equal_peaks(self.setup)))

    @cached_property
    def reversals(self) -> Reversals:
        """Fig. 9."""
        return reversals(self.setup.machines)

    @cached_property
    def gain_sweep(self) -> GainSweep:
        """Fig. 10."""
        return gain_sweep(self.setup)

    @cached_property
    def line_following(self) -> LineFollowing:
        """Fig. 11."""
        return line_following(self.setup)
