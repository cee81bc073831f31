"""Every checkable statement of the paper, with our measurement and the condition under which it holds.

``claims.toml`` holds all texts and thresholds, and says how each claim comes to be met:

*prediction*
    Nothing was fitted to it or put into the model for it: other admissible values could fail it.
*calibration*
    Numbers were fitted so that it holds. It is no evidence.
*construction*
    It follows from the equations or from values put into the model, so every admissible machine meets it.

A claim that does not hold is *not met*, whichever of these it was.
"""

import math
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pter_gym.tools.paper.experiments import measures
from pter_gym.tools.paper.experiments.study import Study

How = Literal["prediction", "calibration", "construction"]
Kind = Literal["prediction", "calibration", "construction", "not met"]

TABLE_TOLERANCE = 0.10
"""Relative tolerance of the entries of Table I."""

NAMES = {
    "baseline": "the present clutches",
    "delrin_experimental": "experimental Delrin",
    "delrin_theoretical": "theoretical Delrin",
}
"""The three machines of Table I in words."""

COLUMNS = (("position error", "in"), ("tip speed", "in/s"), ("tip acceleration", "in/s²"))
"""The columns of Table I with the paper's units."""


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
        Name of the function in ``measures``, from the experiments to the number.
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
        if low == high:
            return f"{low}{unit}"
        if math.isinf(self.at_most):
            return f"≥ {low}{unit}"
        if math.isinf(self.at_least):
            return f"≤ {high}{unit}"
        return f"{low} to {high}{unit}"


@dataclass(frozen=True)
class Claim:
    """A statement with its measured value.

    Attributes
    ----------
    statement
        The claim.
    value
        The measured number, in the statement's unit.
    """

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


def _read() -> tuple[Statement, ...]:
    """Return the statements of ``claims.toml``."""
    table = tomllib.loads(Path(__file__).with_name("claims.toml").read_text("utf-8"))
    for entry in table["claims"]:
        for key in {"note", "reason"} & entry.keys():
            entry[key] = table["texts"].get(entry[key], entry[key])
    return tuple(Statement(**entry) for entry in table["claims"])


STATEMENTS = _read()
"""Every sentence that can be checked, in the order of the paper."""


def check(study: Study, statements: Iterable[Statement] = STATEMENTS) -> tuple[Claim, ...]:
    """Check statements, by default all of them, against the experiments of a study of Table I's three machines."""
    return tuple(_check(study, statement) for statement in statements)


def _check(study: Study, statement: Statement) -> Claim:
    measure: Callable[..., float] = getattr(measures, statement.measure)
    return Claim(statement, float(measure(study, **statement.of)))
