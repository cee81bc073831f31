"""Cases of commands that belong to a tool that is not here are skipped."""

from importlib.metadata import entry_points

import pytest

from pter_gym._commands.main import commands


@pytest.fixture(autouse=True)
def _offered(request: pytest.FixtureRequest) -> None:
    lost = {entry.name for entry in entry_points(group="pter.commands")} - set(commands())
    case = getattr(request.node, "callspec", None)
    for value in case.params.values() if case else ():
        if isinstance(value, str) and (command := value.partition(" ")[0]) in lost:
            pytest.skip(f"{command} is not here")
