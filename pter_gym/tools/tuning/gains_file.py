"""Tuned gains as a TOML file by scenario, law and pace; several searches may write it."""

import json
import re
from collections.abc import Mapping
from typing import Any, cast

from pter_gym._internal.files import FilePath, expand_path, write_text_atomic
from pter_gym._internal.locks import lock_beside, locked
from pter_gym.controllers import CONTROLLERS
from pter_gym.policies.tuned import GainsTable, read_gains
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.scenarios._paces import find_pace
from pter_gym.tools.tuning.search import TunedGains

HEADING = """\
# Gains of laws in SI, found by `pter tune` on training episodes. Each entry holds the command
# that made it, how many gains were tried, the episodes of each trial, and the scores on as many
# episodes that the search had not seen, as means. Gains that were not searched have the defaults
# of the entry.
"""


def add_gains(found: TunedGains, path: FilePath) -> None:
    """Write the gains of a search to a file in place of earlier ones; other entries are kept.

    Raises
    ------
    DataError
        If there is a file that is not as this function writes it.
    StorageError
        If it cannot be written.
    """
    path = expand_path("path", path)
    defaults = vars(CONTROLLERS[found.controller]())
    entry = {
        "command": found.command,
        "trials": found.trials,
        "episodes": found.episodes,
        **found.assessment._asdict(),
        "gains": found.gains,
        "defaults": {name: value for name, value in defaults.items() if name not in found.gains},
    }
    with locked(lock_beside(path)):
        table: dict[str, Any] = dict(read_gains(path))
        name = find_scenario(found.scenario, found.machine, found.path, found.smooth).name
        table.setdefault(name, {}).setdefault(found.controller, {})[found.pace] = entry
        write_text_atomic(path, format_table(table))


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
