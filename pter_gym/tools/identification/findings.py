"""Identified numbers: each with its interval, its state, and its place in a file."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from pter_gym.tools.identification.parameters import Quantity

MAX_REL_HALF_WIDTH = 0.05
"""Half of the 95 % interval over the scale, up to which a number counts as identified."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One number of the result.

    Attributes
    ----------
    quantity
        Name, unit, value and scale.
    low, high
        95 % interval, in the unit: equal to the value where that was kept.
    before
        Value of the start.
    status
        ``identified``: within ±5 % of its scale, by a model that describes the log. ``uncertain``:
        used, but less certain. ``kept``: the log does not determine it, so it is that of the start.
    reason
        Why it is kept.
    """

    quantity: Quantity
    low: float
    high: float
    before: float
    status: str
    reason: str = ""

    @property
    def half_width(self) -> float:
        """Half of the interval, in the unit."""
        return 0.5 * (self.high - self.low)

    @property
    def origin(self) -> str:
        """Where the number comes from, in words."""
        if self.status == "kept":
            return f"not determined by it and kept: {self.reason}"
        unsure = "uncertain, " if self.status == "uncertain" else ""
        return f"{unsure}95 % interval {self.low:.4g} to {self.high:.4g}"


def make_finding(
    quantity: Quantity,
    half: float,
    before: float,
    *,
    reason: str = "",
    sure: bool = True,
    most: float = MAX_REL_HALF_WIDTH,
) -> Finding:
    """Return a finding by half of the interval, or one that is kept for a reason."""
    width = 0.0 if reason else half
    sure = sure and half <= most * quantity.scale
    return Finding(
        quantity=quantity,
        low=quantity.value - width,
        high=quantity.value + width,
        before=before,
        status="kept" if reason else "identified" if sure else "uncertain",
        reason=reason,
    )


def derived_finding(quantity: Quantity, half: float, factors: Sequence[Finding]) -> Finding:
    """Return the finding of a number that is a product of others.

    It is kept if all that it depends on is, and no surer than the least sure of them.
    """
    if half == 0.0 or all(each.status == "kept" for each in factors):
        reason = next(each.reason for each in factors if each.reason)
        return make_finding(quantity, half, quantity.value, reason=reason)
    sure = all(each.status == "identified" for each in factors)
    return make_finding(quantity, half, quantity.value, sure=sure)


def origins_of(findings: Iterable[Finding], log: str) -> dict[str, str]:
    """Return where the numbers of a machine come from, by field, given the log's name."""
    by_place: dict[str, list[Finding]] = {}
    for finding in findings:
        for place in finding.quantity.places:
            by_place.setdefault(place, []).append(finding)
    origins: dict[str, str] = {}
    for place, here in by_place.items():
        kind = "chosen" if all(each.status == "kept" for each in here) else "identified"
        said = f"from {PurePath(log).name}, {'; '.join(each.origin for each in here)}"
        plain = "".join(c if c.isprintable() and c not in '"\\' else "_" for c in said)
        origins[place] = f"{kind}: {plain}"
    return origins
