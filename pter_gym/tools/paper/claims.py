"""The statements of the paper that can be checked, with our measurement and the condition under which each holds.

``claims.toml`` holds all texts and thresholds, and says how each claim comes to be met:

*prediction*
    Nothing was fitted to it or put into the model for it: other admissible values could fail it.
*calibration*
    Numbers were fitted so that it holds. It is no evidence.

A claim that does not hold is *not met*, whichever of these it was. What follows from the equations, so that every
admissible machine meets it, is no claim here but a test of the model.
"""

import math
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from pter_gym._physics.arm import velocity_torque
from pter_gym._physics.model import model_of
from pter_gym.tools.paper.clutch_tests import motion
from pter_gym.tools.paper.path_tests import BEST_GAIN, PLATEAU_FROM, peak_torque
from pter_gym.tools.paper.study import Study

How = Literal["prediction", "calibration"]
Kind = Literal["prediction", "calibration", "not met"]

SIGNS: dict[Kind, str] = {"prediction": "✓", "calibration": "≈", "not met": "✗"}

TABLE_TOLERANCE = 0.10
"""Relative tolerance of the entries of Table I."""

MAX_SATURATED = 0.05
"""Fraction of saturated clutch commands that is not yet significant."""

NAMES = {
    "baseline": "the present clutches",
    "delrin_experimental": "experimental Delrin",
    "delrin_theoretical": "theoretical Delrin",
}
"""The three machines of Table I in words."""

COLUMNS = (("position error", "in"), ("tip speed", "in/s"), ("tip acceleration", "in/s²"))
"""The columns of Table I with the paper's units."""

_STATS: Any = stats


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A claim of the paper and how it is checked.

    Attributes
    ----------
    id
        Short name.
    section
        Section of the paper.
    figure
        Figure of ``pter reproduce`` that shows it.
    claim
        The claim in our own words.
    measured
        What is measured, in words.
    measure
        Name of the function in ``MEASURES``, from the experiments to the number.
    of
        Its arguments.
    unit
        Unit of the number; 1 for a ratio.
    at_least, at_most
        Between these the claim holds.
    how
        How it comes to be met, if it is.
    note
        What a reader should know.
    reason
        Why it is not met, if it is not and the reason is known.
    """

    id: str
    section: str
    figure: str
    claim: str
    measured: str
    measure: str
    how: How
    of: dict[str, Any] = field(default_factory=dict[str, Any])
    unit: str = "1"
    at_least: float = -math.inf
    at_most: float = math.inf
    note: str = ""
    reason: str = ""

    @property
    def condition(self) -> str:
        """The condition under which the claim holds, in words."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        low, high = (f"{bound:.4g}".replace("-", "−") for bound in (self.at_least, self.at_most))
        if math.isinf(self.at_most):
            return f"≥ {low}{unit}"
        if math.isinf(self.at_least):
            return f"≤ {high}{unit}"
        return f"{low} to {high}{unit}"


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
            "id": s.id,
            "section": s.section,
            "figure": s.figure,
            "claim": s.claim,
            "what": s.measured,
            "measured": self.value if math.isfinite(self.value) else None,
            "unit": s.unit,
            "condition": s.condition,
            "holds": self.holds,
            "kind": self.kind,
            "note": s.note,
            "reason": "" if self.holds else s.reason,
        }


def check(study: Study, statements: "Iterable[Statement] | None" = None) -> tuple[Claim, ...]:
    """Check statements, by default all of them, against the experiments of a study of Table I's three machines."""
    chosen = STATEMENTS if statements is None else statements
    return tuple(Claim(each, float(MEASURES[each.measure](study, **each.of))) for each in chosen)


# --- measures ---

BASELINE = "baseline"

MEASURES: dict[str, Callable[..., float]] = {}
"""From a study to the number of a claim, by name."""


def measure(function: Callable[..., float]) -> Callable[..., float]:
    """Offer a function to ``claims.toml``."""
    MEASURES[function.__name__] = function
    return function


def rank_correlation(x: ArrayLike, y: ArrayLike) -> float:
    """Return Spearman's rank correlation of two samples of shape (K,); 0 if one of them is constant."""
    constant = np.ptp(np.asarray(x)) == 0.0 or np.ptp(np.asarray(y)) == 0.0
    return 0.0 if constant else float(_STATS.spearmanr(x, y).statistic)


@measure
def locked_torque_trend(study: Study) -> float:
    """Rank correlation of tip speed and torque of the locked clutch 2 while clutch 1 slips."""
    test = study.single_dof[0]
    speed = np.linalg.norm(test.trajectory.tip_velocity[test.breakaway :], axis=1)
    return rank_correlation(speed, np.abs(test.locked_torque[test.breakaway :]))


@measure
def velocity_share(study: Study) -> float:
    """Share of V2 in the torque of the locked clutch 2 at the end of the test of clutch 1."""
    test = study.single_dof[0]
    run, linkage = test.trajectory, model_of(study.setup.baseline).arm
    _, v2 = velocity_torque(linkage, motion(run.theta[-1], run.omega[-1]))
    locked = float(test.locked_torque[-1])
    return v2 / locked if locked != 0.0 else math.nan


@measure
def weakest_slips(study: Study) -> float:
    """Fraction of the loads at which the weakest clutch slipped."""
    return float(study.holding.weakest_slips.mean())


@measure
def peak_ratio(study: Study, model: str) -> float:
    """Largest torque relative to the baseline's."""
    return peak_torque(study.setup.machines[model]) / peak_torque(study.setup.machines[BASELINE])


@measure
def trend_over_time_constant(study: Study, quantity: str) -> float:
    """Rank correlation of a quantity of the baseline runs with the time constant."""
    sweep = study.sweeps[BASELINE]
    return rank_correlation(sweep.time_constant, getattr(sweep, quantity))


@measure
def table_entry(study: Study, model: str, column: int) -> float:
    """Entry of Table I in the paper's units."""
    return study.table1[model][column]


@measure
def table_ratio(study: Study, model: str, other: str, column: int) -> float:
    """Entry of Table I relative to that of another machine."""
    return study.table1[model][column] / study.table1[other][column]


@measure
def worst_error_ratio(study: Study, model: str, other: str) -> float:
    """Largest position error over the time constants, relative to that of another machine at the same one."""
    return float((study.sweeps[model].position_error / study.sweeps[other].position_error).max())


@measure
def peak_share(study: Study, model: str, column: int) -> float:
    """Share of an entry's excess over the baseline's that disappears with the baseline's peak torque."""
    entry = study.table1[model][column]
    gone = entry - study.table1_equal_peak[model][column]
    return gone / (entry - study.table1[BASELINE][column])


@measure
def error_fall(study: Study) -> float:
    """Rank correlation of error and gain up to the best gain."""
    sweep, chosen = study.gain_sweep, _gains(study, 0.0, BEST_GAIN)
    return rank_correlation(sweep.gain[chosen], sweep.position_error[chosen])


@measure
def plateau_width(study: Study) -> float:
    """Largest deviation of the error from its mean above the gain of saturation, relative to that mean."""
    error = study.gain_sweep.position_error[_gains(study, PLATEAU_FROM)]
    return float(np.abs(error / error.mean() - 1.0).max())


@measure
def saturated_at_best_gain(study: Study) -> float:
    """Fraction of saturated clutch commands at the best gain."""
    return float(study.gain_sweep.saturated[_gains(study, BEST_GAIN, BEST_GAIN)][0])


@measure
def saturation_trend(study: Study) -> float:
    """Rank correlation of saturated fraction and gain above the gain of saturation."""
    sweep, chosen = study.gain_sweep, _gains(study, PLATEAU_FROM)
    return rank_correlation(sweep.gain[chosen], sweep.saturated[chosen])


@measure
def best_gain(study: Study) -> float:
    """Gain with the smallest error among those without significant saturation [V/(in·lbf)]; NaN if none."""
    sweep = study.gain_sweep
    free = sweep.saturated <= MAX_SATURATED
    return float(sweep.gain[free][sweep.position_error[free].argmin()]) if free.any() else math.nan


@measure
def line_following_ratio(study: Study) -> float:
    """Error of the line-following test with feedback relative to that without."""
    test = study.line_following
    return test.with_feedback.score.mean_error_m / test.without.score.mean_error_m


def _gains(study: Study, low: float, high: float = math.inf) -> NDArray[np.bool_]:
    """Return which gains of Fig. 10 lie within a range [V/(in·lbf)]."""
    gain = study.gain_sweep.gain
    return (gain >= low - 1e-9) & (gain <= high + 1e-9)


def _read() -> tuple[Statement, ...]:
    """Return the statements of ``claims.toml``."""
    table = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
    for entry in table["claims"]:
        for key in {"note", "reason"} & entry.keys():
            entry[key] = table["texts"].get(entry[key], entry[key])
    return tuple(Statement(**entry) for entry in table["claims"])


STATEMENTS = _read()
"""The statements, in the order of the paper."""
