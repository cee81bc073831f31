"""Measured hands as TOML files: what ``pter identify --hand`` writes and ``--hand`` reads."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from pter_gym._internal.codec import Codec
from pter_gym._internal.files import FilePath, expand_path, has_ending
from pter_gym._internal.reading import read_toml, reading
from pter_gym.errors import ParameterError
from pter_gym.hands._operators import HumanArm
from pter_gym.params import Hand

_CODEC = Codec((Hand,))


def is_hand_file(hand: object) -> bool:
    """Return whether a hand is given by the path of a file."""
    return isinstance(hand, str) and has_ending(hand, ".toml")


def load_hand(path: FilePath) -> HumanArm:
    """Return a human arm with the mass, damper and spring of a file.

    Raises
    ------
    ParameterError
        If there is no such file, or the hand has no spring.
    DataError
        If it is not TOML, or a field is unknown or out of range.
    """
    file = expand_path("hand", path)
    if not file.is_file():
        raise ParameterError(f"hand must name a file that exists, there is no {str(path)!r}")
    content = read_toml(file, "hand")
    with reading(f"hand {path}"):
        impedance = _CODEC.from_plain(content)
        if not isinstance(impedance, Hand):
            raise ParameterError(f"type must be 'Hand', got {content.get('type')!r:.60}")
        return HumanArm(impedance=impedance)


def format_hand(hand: Hand, origins: Mapping[str, str], title: str) -> str:
    """Return a hand's file as text, with where each number comes from."""
    content: Any = _CODEC.to_plain(hand)
    lines = [*(f"# {line}".rstrip() for line in title.splitlines()), 'type = "Hand"']
    for item in fields(hand):
        if item.name in content:
            origin = origins.get(item.name, item.metadata["provenance"])
            lines.append(f"{item.name} = {content[item.name]}  # {item.metadata['unit']}; {origin}")
    return "\n".join(lines) + "\n"
