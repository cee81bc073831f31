"""Looks of policies, which people with any colour vision can tell apart."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pter_gym.internal.looks import looks, numbered

NAMES = st.lists(st.text(min_size=1, max_size=20), max_size=15, unique=True)

# Machado, Oliveira and Fernandes (2009), severity 1: linear RGB as people without one kind of cone see it
EYES = {
    "usual": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OKLAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def seen(colour: str, eyes: str) -> np.ndarray:
    """A colour in Oklab, where distances are differences that people see."""
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return OKLAB @ np.cbrt(CONES @ np.clip(np.asarray(EYES[eyes]) @ linear, 0.0, 1.0))


@pytest.mark.parametrize("eyes", EYES)
def test_colours_differ_from_each_other_and_from_paper(eyes: str) -> None:
    found = [seen(numbered(k).colour, eyes) for k in range(15)]
    assert min(np.linalg.norm(a - b) for a, b in combinations(found, 2)) > 0.07
    assert max(lab[0] for lab in found) < 0.82  # white has 1


@settings(max_examples=30)
@given(NAMES)
def test_up_to_15_policies_have_neither_colour_nor_marker_in_common(names: list[str]) -> None:
    found = looks(names)
    assert list(found) == names
    assert len({look.colour for look in found.values()}) == len({look.marker for look in found.values()}) == len(names)


def test_looks_do_not_depend_on_the_order_of_the_names() -> None:
    found = looks(["b", "a"])
    assert list(found) == ["b", "a"]
    assert looks(["a", "b", "a"]) == found


def test_many_policies_still_look_different() -> None:
    found = looks(f"policy {k}" for k in range(100))
    assert len({(look.colour, look.marker) for look in found.values()}) == 100
