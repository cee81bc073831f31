"""The public interface stands still: names, parameters, defaults, ids, commands, columns, keys."""

import difflib

import interface  # in docs/make
import pytest


@pytest.mark.agents
def test_the_public_interface_is_the_listed_one() -> None:
    """Whoever changes it says so in CHANGELOG.md, and runs `python docs/make/interface.py`."""
    stored = interface.LISTING.read_text("utf-8").splitlines()
    changes = difflib.unified_diff(stored, interface.listing().splitlines(), lineterm="", n=0)
    assert not list(changes)
