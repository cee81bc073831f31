"""Tuned gains as a TOML file by scenario, law and pace; several searches may write it."""

import json
import re
from collections.abc import Mapping
from typing import Any, cast

from pter_gym._internal.files import FilePath, expand_path, write_text_atomic
from pter_gym._internal.locks import lock_beside, locked
from pter_gym.controllers import CONTROLLERS
from pter_gym.errors import ParameterError
from pter_gym.policies.tuned import GainsTable, read_gains
from pter_gym.scenarios import SCENARIOS, Scenario, find_scenario
from pter_gym.scenarios.paces import find_pace
from pter_gym.tools.tuning.search import TunedGains

HEADING = """\
# Gains of laws in SI, found by `pter tune` on training episodes. Each entry holds the command
# that made it, how many gains were tried, the episodes of each trial, and the scores on as many
# episodes that the search had not seen, as means. Gains that were not searched have the defaults
# of the entry.
"""


def add_gains(found: TunedGains, path: FilePath, *, replace: bool = False) -> None:
    """Write the gains of a search to a file; its other entries are kept.

    Raises
    ------
    ParameterError
        As ``check_place``.
    DataError
        If there is a file that is not as this function writes it.
    StorageError
        If it cannot be written.
    """
    path = expand_path("path", path)
    scenario = find_scenario(found.scenario, found.machine, found.path, found.smooth, found.hand)
    defaults = vars(CONTROLLERS[found.controller]())
    entry = {
        "command": found.command,
        **({"digest": scenario.digest} if scenario.digest else {}),
        "trials": found.trials,
        "episodes": found.episodes,
        **found.assessment._asdict(),
        "gains": found.gains,
        "defaults": {name: value for name, value in defaults.items() if name not in found.gains},
    }
    with locked(lock_beside(path)):
        check_place(path, scenario, found.controller, found.pace, found.command, replace=replace)
        table: dict[str, Any] = dict(read_gains(path))
        table.setdefault(scenario.name, {}).setdefault(found.controller, {})[found.pace] = entry
        write_text_atomic(path, format_table(table))


def check_place(
    path: FilePath, scenario: Scenario, law: str, pace: str, command: str, *, replace: bool
) -> None:
    """Check that a file takes the gains that a command finds for a law, scenario and pace.

    Raises
    ------
    ParameterError
        If it has gains for the same scenario with another machine or path, or those of another
        command at this pace, which are not to be replaced.
    DataError
        If it is not as ``add_gains`` writes it.
    """
    for name, paces in read_gains(path).get(scenario.name, {}).items():
        for at, entry in paces.items():
            is_here = (name, at) == (law, pace)
            is_same = entry.get("digest", "") == scenario.digest
            if is_here and not replace and (entry.get("command") != command or not is_same):
                raise ParameterError(
                    f"out must be another file, unless --replace is given: {str(path)!r} has "
                    f"gains of {law} for {scenario.name} at the pace {pace}"
                )
            if not is_here and not is_same:
                raise ParameterError(
                    f"out must be another file: {str(path)!r} has gains of {name} for "
                    f"{scenario.name} at the pace {at} with another machine or path"
                )


def format_table(table: GainsTable) -> str:
    """Return tuned gains as TOML, in the order of scenarios, laws and paces."""
    blocks = [HEADING]
    for scenario in sorted(table, key=lambda name: [*SCENARIOS, name].index(name)):
        for controller, paces in table[scenario].items():
            for pace in sorted(paces, key=find_pace):
                lines = [f"{name} = {_as_toml(value)}\n" for name, value in paces[pace].items()]
                blocks.append(f"[{_key(scenario)}.{controller}.{_key(pace)}]\n{''.join(lines)}")
    return "\n".join(blocks)


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _as_toml(value: object) -> str:
    """Return a value as TOML, which only writes tables in another way than JSON."""
    if not isinstance(value, Mapping):
        return json.dumps(value, ensure_ascii=False)
    parts = cast("Mapping[str, object]", value).items()
    return "{ " + ", ".join(f"{name} = {_as_toml(part)}" for name, part in parts) + " }"
