"""The claims of the paper, each with our measurement and the condition for it to hold.

``claims.toml`` holds all texts and thresholds. One rule says how each claim comes to be met:

*calibration*
    The calibration's objective or its space contains it (``FITTED``), so it is no evidence.
*prediction*
    They do not, and other machines of the search space fail it.

A claim that does not hold is *not met*, whichever of these it was. What every machine of the space
meets follows from the equations, and is no claim here but a test of the model.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from pter_gym._internal.reading import read_toml
from pter_gym._physics.arm import motion_of, velocity_torque
from pter_gym._physics.model import model_of
from pter_gym.tools.paper.clutch_tests import holding_torque
from pter_gym.tools.paper.experiments import Experiments
from pter_gym.tools.paper.path_tests import PLATEAU_FROM

__all__ = ["Claim", "Statement", "check"]

Kind = Literal["prediction", "calibration", "not met"]

TABLE_TOLERANCE = 0.10
"""Relative tolerance of the entries of Table I."""

FITTED = {
    *("table_entry", "table_ratio", "trend_over_time_constant", "worst_error_ratio"),
    *("trend_over_gain", "plateau_width", "best_gain", "line_following_ratio"),
    *("peak_ratio", "jump_ratio"),
}
"""Measures in the calibration's objective; the last two are ranges of its space."""

MAX_SATURATED = 0.05
"""Largest fraction of saturated clutch commands that is not yet significant, in our reading."""

MACHINE_WORDS = {
    "baseline": "the present clutches",
    "delrin_experimental": "experimental Delrin",
    "delrin_theoretical": "theoretical Delrin",
}
"""The three machines of Table I in words."""

TABLE_COLUMNS = (("position error", "in"), ("tip speed", "in/s"), ("tip acceleration", "in/s²"))
"""The columns of Table I with the paper's units."""


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A claim of the paper and how it is checked.

    Attributes
    ----------
    id, section, figure
        Short name, section of the paper, and the figure of ``pter reproduce`` that shows it.
    paper, claim, measured
        The paper's sentence, the claim in our own words, and what is measured.
    measure, of
        Name of the function in ``MEASURES``, from the experiments to the number, and its arguments.
    unit
        Unit of the number; 1 for a ratio.
    at_least, at_most
        Between these the claim holds.
    note, reason
        What a reader should know; why it is not met, if it is not and the reason is known.
    """

    id: str
    section: str
    figure: str
    paper: str
    claim: str
    measured: str
    measure: str
    of: dict[str, Any] = field(default_factory=dict[str, Any])
    unit: str = "1"
    at_least: float = -math.inf
    at_most: float = math.inf
    note: str = ""
    reason: str = ""

    @property
    def how(self) -> Kind:
        """How it comes to be met, if it is."""
        return "calibration" if self.measure in FITTED else "prediction"

    @property
    def condition(self) -> str:
        """The condition under which the claim holds, in words."""
        low, high = (f"{bound:.4g}".replace("-", "−") for bound in (self.at_least, self.at_most))
        if math.isinf(self.at_most):
            return self.with_unit(f"≥ {low}")
        return self.with_unit(f"≤ {high}" if math.isinf(self.at_least) else f"{low} to {high}")

    def with_unit(self, number: str) -> str:
        """Return a number with the statement's unit."""
        return number if self.unit == "1" else f"{number} {self.unit}"


@dataclass(frozen=True)
class Claim:
    """A statement with its measured value, in the statement's unit."""

    statement: Statement
    value: float

    @property
    def holds(self) -> bool:
        """Whether the number lies within the statement's bounds."""
        return self.statement.at_least <= self.value <= self.statement.at_most

    @property
    def kind(self) -> Kind:
        """The verdict."""
        return self.statement.how if self.holds else "not met"

    def as_json(self) -> dict[str, object]:
        """Return one entry of ``claims.json``."""
        s = self.statement
        return {
            **{key: getattr(s, key) for key in ("id", "section", "figure", "paper", "claim")},
            "what": s.measured,
            "measured": self.value if math.isfinite(self.value) else None,
            "unit": s.unit,
            "condition": s.condition,
            "holds": self.holds,
            "kind": self.kind,
            "note": s.note,
            "reason": "" if self.holds else s.reason,
        }


_TABLE = read_toml(Path(__file__).with_name("claims.toml"), "claims")

STATEMENTS = tuple(
    Statement(
        **entry
        | {
            key: _TABLE["texts"].get(entry[key], entry[key])
            for key in {"note", "reason"} & entry.keys()
        }
    )
    for entry in _TABLE["claims"]
)
"""The statements, in the order of the paper."""


def check(
    experiments: Experiments, statements: Iterable[Statement] = STATEMENTS
) -> tuple[Claim, ...]:
    """Check statements, by default all, against experiments with Table I's three machines."""
    return tuple(
        Claim(each, float(MEASURES[each.measure](experiments, **each.of))) for each in statements
    )


# --- measures ---

PRESENT = "baseline"


def rank_correlation(x: ArrayLike, y: ArrayLike) -> float:
    """Return Spearman's rank correlation of two samples (K,); 0 if one is constant."""
    ranks = [np.sign(np.subtract.outer(values, values)).sum(axis=1) for values in (x, y)]
    return float(np.corrcoef(ranks)[0, 1]) if all(map(np.any, ranks)) else 0.0


def _locked_torque_trend(experiments: Experiments) -> float:
    test = experiments.single_dof[0]
    speed = np.linalg.norm(test.trajectory.tip_velocity[test.breakaway :], axis=1)
    return rank_correlation(speed, np.abs(test.locked_torque[test.breakaway :]))


def _velocity_share(experiments: Experiments) -> float:
    test = experiments.single_dof[0]
    run, locked = test.trajectory, test.locked_torque[-1]
    arm = model_of(experiments.setup.baseline).arm
    _, v2 = velocity_torque(arm, motion_of(run.theta[-1], run.omega[-1]))
    return v2 / locked if locked != 0.0 else math.nan


def _weakest_slips(experiments: Experiments) -> float:
    return experiments.holding.weakest_slips.mean()


def _peak_ratio(experiments: Experiments, model: str) -> float:
    machines = experiments.setup.machines
    return holding_torque(machines[model]) / holding_torque(machines[PRESENT])


def _trend_over_time_constant(experiments: Experiments, quantity: str) -> float:
    sweep = experiments.sweeps[PRESENT]
    return rank_correlation(sweep.time_constant, getattr(sweep, quantity))


def _table_entry(experiments: Experiments, model: str, column: int) -> float:
    return experiments.table1[model][column]


def _jump_ratio(experiments: Experiments, model: str, other: str) -> float:
    own, its = (experiments.reversals[name] for name in (model, other))
    return own.jump * own.dynamic / (its.jump * its.dynamic)


def _table_ratio(experiments: Experiments, model: str, other: str, column: int) -> float:
    return experiments.table1[model][column] / experiments.table1[other][column]


def _worst_error_ratio(experiments: Experiments, model: str, other: str) -> float:
    sweeps = experiments.sweeps
    return (sweeps[model].position_error / sweeps[other].position_error).max()


def _peak_share(experiments: Experiments, model: str, column: int) -> float:
    entry = experiments.table1[model][column]
    return (entry - experiments.table1_equal_peak[model][column]) / (
        entry - experiments.table1[PRESENT][column]
    )


def _trend_over_gain(
    experiments: Experiments, quantity: str, low: float = 0.0, high: float = math.inf
) -> float:
    sweep = experiments.gain_sweep
    chosen = (sweep.gain >= low) & (sweep.gain <= high)
    return rank_correlation(sweep.gain[chosen], getattr(sweep, quantity)[chosen])


def _plateau_width(experiments: Experiments) -> float:
    error = experiments.gain_sweep.position_error[experiments.gain_sweep.gain >= PLATEAU_FROM]
    return np.abs(error / error.mean() - 1.0).max()


def _saturation_begins(experiments: Experiments) -> float:
    sweep = experiments.gain_sweep
    more = sweep.saturated > sweep.saturated[sweep.gain == 0.0]
    return sweep.gain[more][0] if more.any() else math.nan


def _best_gain(experiments: Experiments) -> float:
    sweep = experiments.gain_sweep
    free = sweep.saturated <= MAX_SATURATED
    return sweep.gain[free][sweep.position_error[free].argmin()] if free.any() else math.nan


def _line_following_ratio(experiments: Experiments) -> float:
    without, with_feedback = (
        run.score.path_average_error_m for (run,) in experiments.line_following.runs.values()
    )
    return with_feedback / without


MEASURES: dict[str, Callable[..., float]] = {
    function.__name__.removeprefix("_"): function
    for function in (
        *(_locked_torque_trend, _velocity_share, _weakest_slips, _peak_ratio, _jump_ratio),
        *(_table_entry, _table_ratio, _worst_error_ratio, _peak_share, _trend_over_gain),
        *(_plateau_width, _saturation_begins, _best_gain, _line_following_ratio),
        _trend_over_time_constant,
    )
}
"""From the experiments to the number of a claim; a column is one of Table I, from 0."""
