"""Measured hands as TOML files: what ``pter identify --hand`` writes and ``--hand`` reads."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from pter_gym._internal.codec import Codec
from pter_gym._internal.files import expand_path, has_ending
from pter_gym._internal.reading import read_toml, reading
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.hands._library import LIBRARY_ARMS, LIBRARY_TREMORS
from pter_gym.params import Hand
from pter_gym.params._files import UNCERTAINTY, format_uncertainty, uncertainty_from

if TYPE_CHECKING:
    from pter_gym.hands._operators import HandSpread, HumanArm

_CODEC = Codec((Hand,))

_OWNER = "impedance."
"""Where the numbers of a file are in a human arm."""


def find_impedance(hand: str) -> tuple[Hand, dict[str, Any]]:
    """Return mass, damper and spring of a hand by its file, or name in ``LIBRARY_ARMS``.

    And the places and the covariance of numbers that its file leaves uncertain, if it does.

    Raises
    ------
    ParameterError
        If there is no such file or arm; the message suggests the nearest names.
    DataError
        If a file is not TOML, or a field is unknown or out of range.
    """
    if not has_ending(hand, ".toml"):
        if hand not in LIBRARY_ARMS:
            raise unknown_name("hand", hand, (*LIBRARY_ARMS, *LIBRARY_TREMORS))
        return LIBRARY_ARMS[hand].hand, {}
    file = expand_path("hand", hand)
    if not file.is_file():
        raise ParameterError(f"hand must name a file that exists, there is no {hand!r}")
    content = read_toml(file, "hand")
    with reading(f"hand {hand}"):
        found = _CODEC.from_plain({k: each for k, each in content.items() if k != UNCERTAINTY})
        if not isinstance(found, Hand):
            raise ParameterError(f"type must be 'Hand', got {content.get('type')!r:.60}")
        return found, uncertainty_from(content)


def find_arms(hand: str) -> "HumanArm | HandSpread":
    """Return the human arm of ``find_impedance``, or the arms that a file describes."""
    from pter_gym.hands._operators import HandSpread, HumanArm  # load what is compiled

    found, uncertain = find_impedance(hand)
    with reading(f"hand {hand}"):
        arm = HumanArm(impedance=found)
        if not uncertain:
            return arm
        places = tuple(f"{_OWNER}{place}" for place in uncertain["places"])
        return HandSpread(hand=arm, places=places, covariance=uncertain["covariance"])


def format_hand(hands: "HandSpread", origins: Mapping[str, str], title: str) -> str:
    """Return a hand's file as text, with where each number comes from."""
    hand = hands.hand.impedance
    content: Any = _CODEC.to_plain(hand)
    lines = [*(f"# {line}".rstrip() for line in title.splitlines()), 'type = "Hand"']
    for item in fields(hand):
        if item.name in content:
            origin = origins.get(item.name, item.metadata["provenance"])
            lines.append(f"{item.name} = {content[item.name]}  # {item.metadata['unit']}; {origin}")
    places = [place.removeprefix(_OWNER) for place in hands.places]
    return "\n".join(lines) + "\n" + format_uncertainty(places, hands.covariance)
