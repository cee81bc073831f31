"""All of the paper's experiments on one setup, each run when first needed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from pter_gym.tools.paper import clutch_tests, path_tests
from pter_gym.tools.paper.setup import SETUP, Setup

Found = TypeVar("Found")


def _once(run: "Callable[[Study], Found]") -> cached_property[Found]:
    """Return the property of a study that runs an experiment when it is first asked for."""
    return cached_property(run)


@dataclass(frozen=True)
class Study:
    """The paper's experiments with their default arguments on one setup; results of machines are by their names."""

    setup: Setup = SETUP

    single_dof = _once(lambda study: clutch_tests.single_dof(study.setup.baseline))
    """Figs. 3 and 4, in the order of the clutches."""

    step_response = _once(lambda study: clutch_tests.step_response(study.setup.baseline))
    """The clutch step response of section III-B."""

    holding = _once(lambda study: clutch_tests.holding(study.setup.baseline))
    """Static loads on four engaged clutches (section III-A)."""

    torque_curves = _once(lambda study: clutch_tests.torque_curves(study.setup.machines))
    """Fig. 5."""

    sweeps = _once(lambda study: path_tests.time_constant_sweep(study.setup))
    """Figs. 7 and 8."""

    table1 = _once(lambda study: path_tests.table1(study.sweeps))
    """Table I in the paper's units."""

    sweeps_equal_peak = _once(
        lambda study: path_tests.time_constant_sweep(path_tests.with_equal_peaks(study.setup))
    )
    """Those if every material reached the baseline's largest torque."""

    table1_equal_peak = _once(lambda study: path_tests.table1(study.sweeps_equal_peak))
    """Table I from them."""

    reversals = _once(lambda study: clutch_tests.reversals(study.setup.machines))
    """Fig. 9."""

    gain_sweep = _once(lambda study: path_tests.gain_sweep(study.setup))
    """Fig. 10."""

    line_following = _once(lambda study: path_tests.line_following(study.setup))
    """Fig. 11: the test without and with torque feedback."""
