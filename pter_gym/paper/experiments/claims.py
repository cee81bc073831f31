"""Every sentence of the paper that can be checked, with what we measure and what would make it hold.

``STATEMENTS`` is the one place for thresholds. Three words are used with care: a claim that holds is *calibrated* where
a number was fitted to it or put into the model, and *reproduced* only where it was not; otherwise it is *not met*.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from pter_gym.paper.experiments import measures
from pter_gym.paper.experiments.measures import BASELINE, EXPERIMENTAL, SATURATED, THEORETICAL
from pter_gym.paper.experiments.study import Study
from pter_gym.paper.experiments.time_constants import PAPER_TABLE

Kind = Literal["reproduced", "calibrated", "not met"]

TREND = 0.95
"""Smallest rank correlation that counts as a trend."""

STICTION = 1.12 - 1e-9
"""Smallest ratio of breakaway to dynamic torque that gives a clear jump in Fig. 9."""

TABLE_TOLERANCE = 0.10
"""Relative tolerance of the entries of Table I."""

CLEAR = 0.05
"""Relative difference that counts as higher or lower."""


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
    unit
        Its unit; 1 for a ratio.
    measure
        From the experiments to the number.
    at_least, at_most
        Between these the claim holds.
    given
        Whether a number was fitted to this claim or put into the model, so that its holding is no evidence.
    note
        What a reader should know.
    reason
        Why it is not met, where it is not and the reason was found.
    """

    id: str
    section: str
    figure: str
    claim: str
    measured: str
    measure: Callable[[Study], float]
    unit: str = "1"
    at_least: float = -math.inf
    at_most: float = math.inf
    given: bool = False
    note: str = ""
    reason: str = ""

    @property
    def condition(self) -> str:
        """What would make the claim hold, in words."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        low, high = (f"{bound:.4g}".replace("-", "−") for bound in (self.at_least, self.at_most))
        if low == high:
            return f"{low}{unit}"
        if math.isinf(self.at_most):
            return f"≥ {low}{unit}"
        if math.isinf(self.at_least):
            return f"≤ {high}{unit}"
        return f"{low} to {high}{unit}"


@dataclass(frozen=True)
class Claim:
    """A statement with what was measured.

    Attributes
    ----------
    statement
        The claim.
    value
        The measured number, in the statement's unit.
    holds
        Whether it lies within the statement's bounds.
    """

    statement: Statement
    value: float
    holds: bool

    @property
    def kind(self) -> Kind:
        """The verdict."""
        if not self.holds:
            return "not met"
        return "calibrated" if self.statement.given else "reproduced"

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


def check(study: Study, statements: Iterable[Statement] | None = None) -> tuple[Claim, ...]:
    """Check statements, by default all of them, against the experiments of a study of Table I's three machines."""
    return tuple(_check(study, statement) for statement in (STATEMENTS if statements is None else statements))


def _check(study: Study, statement: Statement) -> Claim:
    value = float(statement.measure(study))
    return Claim(statement, value, bool(statement.at_least <= value <= statement.at_most))


NAMES = {BASELINE: "the present clutches", EXPERIMENTAL: "experimental Delrin", THEORETICAL: "theoretical Delrin"}
"""The three machines of Table I in words."""

COLUMNS = (("position error", "in"), ("tip speed", "in/s"), ("tip acceleration", "in/s²"))
"""The columns of Table I with the paper's units."""


TRADE_OFF = (
    "No set of values was found that meets all of Table I and the trends; docs/calibration.md shows the trade-off."
)

FITTED_TREND = "Part of the calibration's objective, so that its holding is no evidence."


def _table_statements() -> tuple[Statement, ...]:
    return tuple(
        Statement(
            id=f"table1-{model}-{name.replace(' ', '-')}".replace("_", "-"),
            section="IV-C.2, Table I",
            figure="table1",
            claim=f"With {NAMES[model]} the average {name} is {PAPER_TABLE[model][column]:g} {unit}.",
            measured=f"average {name} over the time constants",
            measure=partial(measures.table_entry, model=model, column=column),
            unit=unit,
            at_least=PAPER_TABLE[model][column] * (1.0 - TABLE_TOLERANCE),
            at_most=PAPER_TABLE[model][column] * (1.0 + TABLE_TOLERANCE),
            given=True,
            note=f"Fitted; {TABLE_TOLERANCE:.0%} off counts as met.",
            reason=TRADE_OFF,
        )
        for model in PAPER_TABLE
        for column, (name, unit) in enumerate(COLUMNS)
    )


def _trend(quantity: str, figure: str, claim: str, *, rises: bool = True) -> Statement:
    return Statement(
        id=f"trend-{quantity.replace('_', '-')}",
        section="IV-C.1",
        figure=figure,
        claim=claim,
        measured=f"rank correlation of {quantity.replace('_', ' ')} and time constant",
        measure=partial(measures.trend_over_time_constant, quantity=quantity),
        at_least=TREND if rises else -math.inf,
        at_most=math.inf if rises else -TREND,
        given=True,
        note=FITTED_TREND,
        reason=TRADE_OFF,
    )


STATEMENTS: tuple[Statement, ...] = (
    Statement(
        id="passive",
        section="I",
        figure="fig4",
        claim="The actuators can only take energy out of the system.",
        measured="largest power of any clutch on the arm in the runs of Figs. 3, 4 and 9",
        measure=measures.largest_power,
        unit="W",
        at_most=0.0,
    ),
    Statement(
        id="stuck-cancels",
        section="II-A",
        figure="fig4",
        claim="While a clutch sticks, its friction exactly cancels what drives it.",
        measured="largest imbalance before breakaway, relative to the breakaway torque, over four clutches",
        measure=measures.stuck_imbalance,
        at_most=1e-9,
    ),
    Statement(
        id="first-order",
        section="II-B, III-B",
        figure="step",
        claim="A clutch answers a step of its voltage with a first-order step response of its torque.",
        measured="largest deviation from first order, relative to the final torque, over four clutches",
        measure=measures.first_order_deviation,
        at_most=0.01,
        note="The lag is an equation of the model; the test shows that the generated torque follows it.",
    ),
    Statement(
        id="six-modes",
        section="III-A",
        figure="fig3",
        claim="The system has six dynamic modes: two degrees of freedom, one (in four ways) and none.",
        measured="different modes in the runs of Figs. 3, 4 and 9",
        measure=measures.modes_seen,
        at_least=6,
        at_most=6,
    ),
    Statement(
        id="lumped-holds",
        section="III-A",
        figure="fig4",
        claim="The arm stays still as long as some set of clutch torques within their limits balances the load.",
        measured="difference of the load that moves the arm and the largest balanced one, relative, worst of 200",
        measure=measures.holding_deviation,
        at_most=1e-3,
        note="The load rises in steps of 0.05%.",
    ),
    Statement(
        id="weakest-slips",
        section="III-A",
        figure="fig4",
        claim="When no such set exists, the weakest clutch starts to slip.",
        measured="fraction of 200 random loads at which the clutch with the lowest breakaway torque slips",
        measure=measures.weakest_slips,
        at_least=1.0,
        reason="A departure of ours: which clutches slip follows from all four together, by maximum dissipation. At "
        "some loads the weakest clutch is the one whose slip the motion does not need.",
    ),
    Statement(
        id="absorbed",
        section="III-B",
        figure="fig4",
        claim="The clutch absorbs the ramp up to its breakaway torque, 63.5 in·lbf.",
        measured="largest clutch torque, the one of four clutches that is farthest from 63.5",
        measure=measures.absorbed_torque,
        unit="in·lbf",
        at_least=63.3,
        at_most=63.7,
        given=True,
        note="The small voltage is chosen for this level.",
    ),
    Statement(
        id="reverts-to-dynamic",
        section="III-B",
        figure="fig4",
        claim="Once it slips, its torque is the dynamic one, which is lower.",
        measured="torque while slipping, relative to the breakaway torque, largest of four clutches",
        measure=measures.sliding_ratio,
        at_most=0.99,
    ),
    Statement(
        id="follows-line",
        section="III-B",
        figure="fig3",
        claim="With one clutch locked, the tip follows its single-degree-of-freedom line.",
        measured="largest distance from the line, over four clutches",
        measure=measures.line_deviation,
        unit="mm",
        at_most=1e-3,
    ),
    Statement(
        id="locked-torque-rises",
        section="III-B",
        figure="fig4",
        claim="The torque of the locked clutch 2 grows as the tip gets faster.",
        measured="rank correlation of its magnitude and tip speed while clutch 1 slips",
        measure=measures.locked_torque_trend,
        at_least=TREND,
    ),
    Statement(
        id="velocity-term",
        section="III-B",
        figure="fig4",
        claim="Although nothing drives link B from outside, the velocity term V2 loads it.",
        measured="share of V2 in clutch 2's torque at the end of the test",
        measure=measures.velocity_share,
        at_least=0.2,
        note="The rest is M21·θ̈A, which the paper does not mention.",
    ),
    Statement(
        id="zero-without-voltage",
        section="IV-B.1",
        figure="fig5",
        claim="Without voltage a clutch has no torque.",
        measured="largest torque at 0 V",
        measure=measures.torque_without_voltage,
        unit="N·m",
        at_most=1e-9,
        given=True,
        note="The paper's assumption, put into the model.",
    ),
    Statement(
        id="stiction-baseline",
        section="IV-B.1, Fig. 5",
        figure="fig5",
        claim="The present clutches have a higher breakaway than dynamic torque.",
        measured="smallest ratio of breakaway to dynamic torque",
        measure=partial(measures.breakaway_ratio, model=BASELINE),
        at_least=STICTION,
        given=True,
        note="Put into the model: a smaller ratio would hide the jump of Fig. 9.",
    ),
    Statement(
        id="stiction-experimental",
        section="IV-C.2",
        figure="fig5",
        claim="Delrin as measured sticks and slips like the present clutches.",
        measured="smallest ratio of breakaway to dynamic torque",
        measure=partial(measures.breakaway_ratio, model=EXPERIMENTAL),
        at_least=STICTION,
        given=True,
        note="Put into the model: a smaller ratio would hide the jump of Fig. 9.",
    ),
    Statement(
        id="delrin-dynamic",
        section="IV-B.2",
        figure="fig5",
        claim="Delrin as published has a higher dynamic than static friction (0.35 and 0.20).",
        measured="smallest ratio of dynamic to breakaway torque",
        measure=partial(measures.dynamic_ratio, model=THEORETICAL),
        at_least=1.74,
        at_most=1.76,
        given=True,
        note="The published coefficients, put into the model.",
    ),
    Statement(
        id="lower-peak-experimental",
        section="IV-C.2",
        figure="fig5",
        claim="Experimental Delrin has a lower peak torque than the present clutches.",
        measured="peak torque relative to the present clutches",
        measure=partial(measures.peak_ratio, model=EXPERIMENTAL),
        at_most=1.0 - CLEAR,
        given=True,
        note="The scale of this material is fitted.",
    ),
    Statement(
        id="lower-peak-theoretical",
        section="IV-C.2",
        figure="fig5",
        claim="Theoretical Delrin has a lower peak torque than the present clutches.",
        measured="peak torque relative to the present clutches",
        measure=partial(measures.peak_ratio, model=THEORETICAL),
        at_most=1.0 - CLEAR,
        note="Follows from the published coefficients and T_s/T_k of the present clutches.",
    ),
    Statement(
        id="disturbance",
        section="IV-A, Eq. 5",
        figure="fig7",
        claim="The force across the path is Fmax/5 times a sum of five sines of 0.5 to 8 Hz.",
        measured="largest difference of the hand's force from Eq. 5, relative to Fmax",
        measure=measures.disturbance_deviation,
        at_most=1e-9,
        given=True,
        note="The paper's definition, put into the task.",
    ),
    _trend("position_error", "fig7", "The path-average position error tends to grow with the time constant."),
    _trend("peak_acceleration", "fig8", "The peak acceleration of the tip falls with the time constant.", rises=False),
    _trend("path_length", "fig8", "The path of the tip gets longer with the time constant."),
    _trend("tip_speed", "fig8", "The average tip speed grows with the time constant."),
    *_table_statements(),
    Statement(
        id="similar-errors",
        section="IV-C.2",
        figure="table1",
        claim="Baseline and experimental Delrin have similar position errors.",
        measured="experimental Delrin relative to the baseline",
        measure=partial(measures.table_ratio, model=EXPERIMENTAL, other=BASELINE, column=0),
        at_least=1.0 - 2.0 * CLEAR,
        at_most=1.0 + 2.0 * CLEAR,
        given=True,
        note="Follows from two fitted entries of Table I.",
    ),
    *(
        Statement(
            id=f"{model.removeprefix('delrin_')}-faster-{name.split()[-1]}",
            section="IV-C.2",
            figure="table1",
            claim=f"The average {name} is higher with {NAMES[model]} than with the present clutches.",
            measured="relative to the present clutches",
            measure=partial(measures.table_ratio, model=model, other=BASELINE, column=column),
            at_least=1.0 + CLEAR,
            given=True,
            note="Follows from two fitted entries of Table I.",
        )
        for model in (EXPERIMENTAL, THEORETICAL)
        for column, (name, _) in enumerate(COLUMNS)
        if column > 0
    ),
    *(
        Statement(
            id=f"theoretical-better-than-{other.removeprefix('delrin_')}",
            section="IV-C.2",
            figure="table1",
            claim=f"Theoretical Delrin follows the path better than {NAMES[other]}.",
            measured="position error relative to the other material",
            measure=partial(measures.table_ratio, model=THEORETICAL, other=other, column=0),
            at_most=1.0 - CLEAR,
            given=True,
            note="Follows from two fitted entries of Table I.",
        )
        for other in (BASELINE, EXPERIMENTAL)
    ),
    *(
        Statement(
            id=f"peak-explains-{model.removeprefix('delrin_')}-{name.split()[-1]}",
            section="IV-C.2, V",
            figure="table1",
            claim=f"The higher {name} of {NAMES[model]} is due to its lower peak torque.",
            measured=f"average {name} if this material had the baseline's peak torque, relative to as it is",
            measure=partial(measures.equal_peak_ratio, model=model, column=column),
            at_most=1.0 - CLEAR,
            note="The paper calls it likely; here the material's torques are scaled up and the runs repeated.",
            reason="Raising its peak torque leaves the acceleration as it is; T_s/T_k makes the difference.",
        )
        for model in (EXPERIMENTAL, THEORETICAL)
        for column, (name, _) in enumerate(COLUMNS)
        if column > 0
    ),
    *(
        Statement(
            id=f"jump-{model.removeprefix('delrin_')}",
            section="IV-C.2, Fig. 9",
            figure="fig9",
            claim=f"With {NAMES[model]} the torque jumps where the direction of motion changes.",
            measured="largest torque within 50 ms of zero slip, relative to the dynamic one, minus 1",
            measure=partial(measures.jump, model=model),
            at_least=0.10,
            given=True,
            note="T_s/T_k ≥ 1.12 is put into the model because of this figure.",
        )
        for model in (BASELINE, EXPERIMENTAL)
    ),
    Statement(
        id="jump-similar",
        section="IV-C.2, Fig. 9",
        figure="fig9",
        claim="The two jumps are similar.",
        measured="jump of experimental Delrin relative to that of the present clutches",
        measure=measures.jump_ratio,
        at_least=0.5,
        at_most=2.0,
        given=True,
        note="T_s/T_k of both materials is put into the model.",
        reason="The fit to Table I put T_s/T_k at 1.43 for experimental Delrin and at 1.12 for the present clutches.",
    ),
    Statement(
        id="jump-theoretical",
        section="IV-C.2, Fig. 9",
        figure="fig9",
        claim="With theoretical Delrin there is no such jump.",
        measured="largest torque within 50 ms of zero slip, relative to the dynamic one, minus 1",
        measure=partial(measures.jump, model=THEORETICAL),
        at_most=0.01,
        note="For T_k > T_s the model is in the limit of a vanishing stick band, in which nothing exceeds T_k.",
    ),
    Statement(
        id="lower-jerk",
        section="IV-C.2",
        figure="fig9",
        claim="A Delrin clutch as published would give a lower jerk, a smoother feel.",
        measured="drop of the torque as slip resumes, relative to the present clutches",
        measure=measures.drop_ratio,
        at_most=0.1,
        note="Follows from the missing jump.",
    ),
    Statement(
        id="feedback-falls",
        section="IV-C.3, Fig. 10",
        figure="fig10",
        claim="The position error falls with the gain of the torque feedback, up to the optimum of 0.06.",
        measured="rank correlation of error and gain up to 0.06",
        measure=measures.error_fall,
        at_most=-TREND,
        given=True,
        note=FITTED_TREND,
    ),
    Statement(
        id="feedback-gains",
        section="IV-C.3, Fig. 10",
        figure="fig10",
        claim="Torque feedback improves path following significantly.",
        measured="error at Kp = 0.06 relative to that without feedback",
        measure=measures.error_at_best_gain,
        at_most=0.9,
        given=True,
        note=FITTED_TREND,
    ),
    Statement(
        id="feedback-plateau",
        section="IV-C.3, Fig. 10",
        figure="fig10",
        claim="Above a gain of 0.1 the error stays about constant.",
        measured="largest deviation from the mean error above 0.1, relative",
        measure=measures.plateau_width,
        at_most=0.1,
        given=True,
        note=FITTED_TREND,
    ),
    Statement(
        id="saturation-small",
        section="IV-C.3",
        figure="fig10",
        claim="At a gain of 0.06 the clutches do not saturate significantly yet.",
        measured="fraction of clutch commands at the largest voltage",
        measure=measures.saturated_at_best_gain,
        at_most=SATURATED,
        given=True,
        note=FITTED_TREND,
    ),
    Statement(
        id="saturation-grows",
        section="IV-C.3",
        figure="fig10",
        claim="Above a gain of 0.1 the controller saturates the clutches more and more.",
        measured="rank correlation of saturated fraction and gain above 0.1",
        measure=measures.saturation_trend,
        at_least=TREND,
        given=True,
        note=FITTED_TREND,
    ),
    Statement(
        id="best-gain",
        section="IV-C.3",
        figure="fig10",
        claim="0.06 is the best gain before the clutches saturate significantly.",
        measured=f"error at 0.06 relative to the smallest one with at most {SATURATED:.0%} of the commands saturated",
        measure=measures.best_gain_optimality,
        at_most=1.0 + CLEAR,
        given=True,
        note=FITTED_TREND,
        reason="With the calibrated values the error falls on beyond 0.06, by a sixth, before saturation is large.",
    ),
    Statement(
        id="line-following",
        section="IV-C.3, Fig. 11",
        figure="fig11",
        claim="With torque feedback at 0.06 the arm follows the line better.",
        measured="position error relative to that without feedback",
        measure=measures.line_following_ratio,
        at_most=1.0 - CLEAR,
        given=True,
        note=FITTED_TREND,
    ),
)
"""Every sentence that can be checked, in the order of the paper."""
