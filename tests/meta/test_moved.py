"""Modules that have moved are found by their old names, and are the same modules."""

import subprocess
import sys
from importlib import import_module

import pytest

from pter_gym._moved import MOVED


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_gives_the_very_module(old: str):
    assert import_module(old) is import_module(MOVED[old])


@pytest.mark.parametrize("old_first", [True, False])
def test_a_module_of_a_moved_package_loads_once(old_first: bool):
    names = ["pter_gym.experiments.claims", "pter_gym.paper.experiments.claims"]
    program = f"import sys, {', '.join(names if old_first else names[::-1])}\n"
    program += f"one, two = (sys.modules[name] for name in {names})\nassert one is two\n"
    program += f"assert one.__spec__.name == one.__name__ == {names[1]!r}\n"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_an_unknown_module_of_a_moved_package_is_missing():
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        import_module("pter_gym.experiments.no_such_module")
