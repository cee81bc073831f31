"""Dataclasses of users whose module has its types as text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import pytest

from pter_gym._internal.fields import Checked, parameter
from pter_gym.controllers import Impedance
from pter_gym.errors import ParameterError
from pter_gym.hands._operators import NO_HAND
from pter_gym.params import Hand
from pter_gym.paths import Line, Path
from pter_gym.paths._arcs import Arcs


@dataclass(frozen=True, kw_only=True)
class Mark(Path):
    size: float = parameter("m", "chosen", above=0.0, default=1.0)
    count: int = parameter("1", "chosen", at_least=2, default=2)
    weights: tuple[float, ...] = parameter("1", "chosen", count=2, default=(0.0, 0.0))
    side: Literal["left", "right"] = "left"
    hand: Hand = NO_HAND

    def make_arcs(self) -> Arcs:
        return Line(length=self.size).arcs


@dataclass(frozen=True, kw_only=True)
class Own(Impedance):
    lead: float = parameter("m", "chosen", default=0.1)
    early: bool = parameter("1", "chosen", default=False)


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (Mark, "size", -3.0),
        (Mark, "size", "three"),
        (Mark, "count", 1),
        (Mark, "weights", (1.0,)),
        (Mark, "side", "up"),
        (Mark, "hand", 3),
        (Own, "lead", "far"),
        (Own, "early", 1.0),
    ],
)
def test_fields_are_checked_though_their_types_are_text(kind: Any, field: str, value: Any) -> None:
    kind()
    with pytest.raises(ParameterError, match=rf"{kind.__name__}\.{field}"):
        kind(**{field: value})


def test_a_type_that_the_module_does_not_have_is_named() -> None:
    @dataclass(frozen=True)
    class Wrong(Checked):
        size: Metres = 1.0  # type: ignore[name-defined]  # noqa: F821  # pyright: ignore[reportUndefinedVariable]

    with pytest.raises(ParameterError, match=r"Wrong must have fields of known types: .*Metres"):
        Wrong()
