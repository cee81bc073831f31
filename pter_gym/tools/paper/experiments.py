"""All of the paper's experiments on one setup, each run when first needed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any, TypeVar

from pter_gym.tools.paper import clutch_tests, path_tests
from pter_gym.tools.paper.parameters import SETUP, Setup

Found = TypeVar("Found")


def _once(run: Callable[[Any], Found], of: str) -> cached_property[Found]:
    """Return a property that, when first read, runs an experiment on an attribute."""
    return cached_property(lambda experiments: run(attrgetter(of)(experiments)))


@dataclass(frozen=True)
class Experiments:
    """The paper's experiments on one setup; results of machines are by their names."""

    setup: Setup = SETUP

    single_dof = _once(clutch_tests.single_dof, "setup.baseline")
    """Figs. 3 and 4, in the order of the clutches."""

    step_response = _once(clutch_tests.step_response, "setup.baseline")
    """The clutch step response of section III-B."""

    holding = _once(clutch_tests.holding, "setup.baseline")
    """Static loads on four engaged clutches (section III-A)."""

    torque_curves = _once(clutch_tests.torque_curves, "setup.machines")
    """Fig. 5."""

    sweeps = _once(path_tests.time_constant_sweep, "setup")
    """Figs. 7 and 8."""

    table1 = _once(path_tests.table1, "sweeps")
    """Table I in the paper's units."""

    table1_equal_peak = _once(
        lambda setup: path_tests.table1(
            path_tests.time_constant_sweep(path_tests.with_equal_peaks(setup))
        ),
        "setup",
    )
    """Table I if every material reached the baseline's largest torque."""

    reversals = _once(clutch_tests.reversals, "setup.machines")
    """Fig. 9."""

    gain_sweep = _once(path_tests.gain_sweep, "setup")
    """Fig. 10."""

    line_following = _once(path_tests.line_following, "setup")
    """Fig. 11: the test without and with torque feedback."""
