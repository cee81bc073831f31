"""All of the paper's experiments on one setup, each run when first needed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from pter_gym.tools.paper import clutch_tests, path_tests
from pter_gym.tools.paper.parameters import SETUP, Setup

Result = TypeVar("Result")


def _once(run: "Callable[[Experiments], Result]") -> cached_property[Result]:
    """Return a property that runs an experiment when it is first read."""
    return cached_property(run)


@dataclass(frozen=True)
class Experiments:
    """The paper's experiments on one setup; results of machines are by their names."""

    setup: Setup = SETUP

    single_dof = _once(lambda experiments: clutch_tests.single_dof(experiments.setup.baseline))
    """Figs. 3 and 4, in the order of the clutches."""

    step_response = _once(
        lambda experiments: clutch_tests.step_response(experiments.setup.baseline)
    )
    """The clutch step response of section III-B."""

    holding = _once(lambda experiments: clutch_tests.holding(experiments.setup.baseline))
    """Static loads on four engaged clutches (section III-A)."""

    torque_curves = _once(
        lambda experiments: clutch_tests.torque_curves(experiments.setup.machines)
    )
    """Fig. 5."""

    sweeps = _once(lambda experiments: path_tests.time_constant_sweep(experiments.setup))
    """Figs. 7 and 8."""

    table1 = _once(lambda experiments: path_tests.table1(experiments.sweeps))
    """Table I in the paper's units."""

    table1_equal_peak = _once(
        lambda experiments: path_tests.table1(
            path_tests.time_constant_sweep(path_tests.with_equal_peaks(experiments.setup))
        )
    )
    """Table I if every material reached the baseline's largest torque."""

    reversals = _once(lambda experiments: clutch_tests.reversals(experiments.setup.machines))
    """Fig. 9."""

    gain_sweep = _once(lambda experiments: path_tests.gain_sweep(experiments.setup))
    """Fig. 10."""

    line_following = _once(lambda experiments: path_tests.line_following(experiments.setup))
    """Fig. 11: the test without and with torque feedback."""
