"""What a claim of the paper is, when it holds, and what is measured against it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pter_gym.paper.experiments.measures import BASELINE, EXPERIMENTAL, THEORETICAL
from pter_gym.paper.experiments.study import Study

Kind = Literal["reproduced", "calibrated", "not met"]

TREND = 0.95
"""Smallest rank correlation that counts as a trend."""

STICTION = 1.12 - 1e-9
"""Smallest ratio of breakaway to dynamic torque that gives a clear jump in Fig. 9."""

TABLE_TOLERANCE = 0.10
"""Relative tolerance of the entries of Table I."""

CLEAR = 0.05
"""Relative difference that counts as higher or lower."""

NAMES = {BASELINE: "the present clutches", EXPERIMENTAL: "experimental Delrin", THEORETICAL: "theoretical Delrin"}
"""The three machines of Table I in words."""

COLUMNS = (("position error", "in"), ("tip speed", "in/s"), ("tip acceleration", "in/s²"))
"""The columns of Table I with the paper's units."""

FITTED_TREND = "Part of the calibration's objective, so that its holding is no evidence."

TRADE_OFF = (
    "No set of values was found that meets all of Table I and the trends; docs/calibration.md shows the trade-off."
)


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
        Whether a number was fitted to this claim or put into the model, so its holding is no evidence.
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
