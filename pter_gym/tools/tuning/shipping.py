"""Tuned gains as a file: a table for each scenario, controller and pace, which several tuners may write to."""

import json
from collections.abc import Iterator, Mapping
from shlex import quote
from typing import Any, cast

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.locks import locked
from pter_gym.benchmark.tuned import Table, read_table
from pter_gym.policies._stored_gains import gains_of, make_guided
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tools.tuning.search import TunedGains

HEADING = (
    "Gains of controllers in SI, found by `pter tune` on training draws. Each entry holds the command that made it,",
    "how many gains were tried from how many starts, the training draws of each trial, and the scores on as many draws",
    "that the search had not seen, as means. Gains that were not searched have the defaults of the entry.",
)


def command_of(found: TunedGains) -> str:
    """Return the command that repeats a search."""
    command = (
        f"pter tune {found.controller} --scenario {found.scenario} --pace {found.pace} --trials {found.trials} "
        f"--starts {found.starts} --episodes {found.episodes} --seed {found.seed}{'' if found.known else ' --no-known'}"
    )
    if found.machine is None:
        return command
    return f"{command} --machine {quote(found.machine) if isinstance(found.machine, str) else 'PRESET.toml'}"


def entry_of(found: TunedGains) -> dict[str, Any]:
    """Return a search's entry in a file."""
    usual = gains_of(make_guided(found.controller, {}))
    return {
        "command": command_of(found),
        "trials": found.trials,
        "starts": found.starts,
        "episodes": found.episodes,
        **found.assessment._asdict(),
        "gains": found.gains,
        "defaults": {name: value for name, value in usual.items() if name not in found.gains},
    }


def add_gains(found: TunedGains, path: FilePath) -> None:
    """Write the gains of a search to a file, replacing earlier ones for the same case; its other entries are kept.

    Raises
    ------
    DataError
        If there is a file that is not as this function writes it.
    StorageError
        If it cannot be written.
    """
    path = find_path("path", path)
    with locked(path.with_name(f".{path.name}.lock")):
        table: dict[str, Any] = dict(read_table(path))
        table.setdefault(found.scenario, {}).setdefault(found.controller, {})[found.pace] = entry_of(found)
        write_text_atomic(path, format_table(table))


def format_table(table: Table) -> str:
    """Return tuned gains as TOML, in the order of scenarios, controllers and paces."""
    return "\n".join(_lines(table)) + "\n"


def _lines(table: Table) -> Iterator[str]:
    yield from (f"# {line}" for line in HEADING)
    for scenario in sorted(table, key=list(SCENARIOS).index):
        for controller, paces in table[scenario].items():
            for pace in sorted(paces, key=list(PACES).index):
                yield from ("", f"[{scenario}.{controller}.{pace}]")
                yield from (f"{name} = {_value(value)}" for name, value in paces[pace].items())


def _value(value: object) -> str:
    """Return a number, boolean, string, or a list or table of these, as TOML."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, cast('tuple[object, ...]', value)))}]"
    if isinstance(value, Mapping):
        parts = cast("Mapping[str, object]", value).items()
        return "{ " + ", ".join(f"{name} = {_value(part)}" for name, part in parts) + " }"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # the one character that TOML adds
    return repr(value)
