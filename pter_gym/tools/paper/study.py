"""All of the paper's experiments on one setup, each run when first needed."""

from dataclasses import dataclass, field
from functools import cached_property

from pter_gym.tools.paper import clutch_tests, path_tests
from pter_gym.tools.paper.clutch_tests import Holding, MaterialCurves, Reversal, SingleDofTest, StepResponse
from pter_gym.tools.paper.path_tests import GainSweep, Sweep
from pter_gym.tools.paper.setup import Setup
from pter_gym.tools.paper.standard_test import Result


@dataclass(frozen=True)
class Study:
    """The paper's experiments with their default arguments on one setup."""

    setup: Setup = field(default_factory=Setup)

    @cached_property
    def single_dof(self) -> tuple[SingleDofTest, ...]:
        """Figs. 3 and 4, in the order of the clutches."""
        return clutch_tests.single_dof(self.setup.baseline)

    @cached_property
    def step_response(self) -> StepResponse:
        """The clutch step response of section III-B."""
        return clutch_tests.step_response(self.setup.baseline)

    @cached_property
    def holding(self) -> Holding:
        """Static loads on four engaged clutches (section III-A)."""
        return clutch_tests.holding(self.setup.baseline)

    @cached_property
    def torque_curves(self) -> dict[str, MaterialCurves]:
        """Fig. 5, by the machine's name."""
        return clutch_tests.torque_curves(self.setup.machines)

    @cached_property
    def sweeps(self) -> dict[str, Sweep]:
        """Figs. 7 and 8, by the machine's name."""
        return path_tests.time_constant_sweep(self.setup)

    @cached_property
    def table1(self) -> dict[str, tuple[float, float, float]]:
        """Table I in the paper's units, by the machine's name."""
        return path_tests.table1(self.sweeps)

    @cached_property
    def table1_equal_peak(self) -> dict[str, tuple[float, float, float]]:
        """Table I if every material reached the baseline's largest torque."""
        return path_tests.table1(path_tests.time_constant_sweep(path_tests.with_equal_peaks(self.setup)))

    @cached_property
    def policies(self) -> dict[str, Sweep]:
        """The standard test of the scenarios' machine, by control law."""
        return path_tests.policy_sweep()

    @cached_property
    def reversals(self) -> dict[str, Reversal]:
        """Fig. 9, by the machine's name."""
        return clutch_tests.reversals(self.setup.machines)

    @cached_property
    def gain_sweep(self) -> GainSweep:
        """Fig. 10."""
        return path_tests.gain_sweep(self.setup)

    @cached_property
    def line_following(self) -> Result:
        """Fig. 11: the test without and with torque feedback."""
        return path_tests.line_following(self.setup)
