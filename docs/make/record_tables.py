"""Write the tables in docs/environment.md, after a declaration has changed: `python docs/make/record_tables.py`."""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, fields
from itertools import islice
from typing import Any, get_args

import tyro
from pages import ROOT, table, write_block

from pter_gym.compiled.layout import Layout
from pter_gym.compiled.records import layout_of, leaves, parts, width
from pter_gym.controllers import Impedance, SingleDof, TorqueFeedback, VelocityRatio
from pter_gym.controllers.gains import Gains, Nominal
from pter_gym.engine.law import Memory
from pter_gym.engine.world import BASIC_ROWS, CONSTANT_ROWS, STORED_ROWS, World
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, RewardWeights, Sensing, Sensors, Starts
from pter_gym.tasks.path_following.context import TOLD
from pter_gym.tasks.path_following.observation import Observation

PAGE = ROOT / "docs" / "environment.md"
LAWS = (Impedance, TorqueFeedback, SingleDof, VelocityRatio)


def code(text: str) -> str:
    """The text in the font of code."""
    return f"`{text}`"


def rows_table(header: list[str], rows: Iterable[list[str]]) -> str:
    """A table whose cells may hold vertical lines."""
    return table(header, [[cell.replace("|", r"\|") for cell in row] for row in rows], "---")


def entries_table(entries: Layout) -> str:
    """Name, unit and meaning of entries that are stored in their units."""
    rows = ([code(entry.name), entry.unit, entry.meaning] for entry in entries.fields)
    return rows_table(["Name", "Unit", "Meaning"], rows)


def observation_table() -> str:
    """All entries that an observation may hold, and the sensors that bring them."""
    entries = zip(leaves(Observation), layout_of(Observation, BASELINE).fields, strict=True)
    rows = (
        [code(entry.name), entry.unit, f"{entry.scale:g}", entry.meaning, brought_by(leaf.entries[0].sensors)]
        for leaf, entry in entries
    )
    return rows_table(["Name", "Unit", "Scale", "Meaning", "Sensors"], rows)


def brought_by(sensors: tuple[str, ...]) -> str:
    """The sensors that bring an entry, or that all do."""
    return "all" if sensors == get_args(Sensors) else ", ".join(map(code, sensors))


def context_table() -> str:
    """What may be told of machine and task."""
    rows = ([code(entry.name), entry.unit, f"{entry.scale:g}", entry.meaning] for entry in TOLD.fields)
    return rows_table(["Name", "Unit", "Scale", "Meaning"], rows)


def fields_table(kind: Any) -> str:
    """Every field of a dataclass of parameters with unit, default and provenance."""
    rows = (
        [code(item.name), item.metadata["unit"], default(item), item.metadata["provenance"]] for item in fields(kind)
    )
    return rows_table(["Name", "Unit", "Default", "Provenance"], rows)


def default(item: Field[Any]) -> str:
    """The default of a field: a number or several, or the class of a default record."""
    if item.default is MISSING:
        return "none"
    if isinstance(item.default, tuple):
        return ", ".join(f"{each:g}" for each in item.default)
    return f"{item.default:g}" if isinstance(item.default, (int, float)) else code(f"{type(item.default).__name__}()")


def world_table(first: int, last: int) -> str:
    """Rows of a world by the field of ``World`` that holds them."""
    entries = (leaf.field(BASELINE) for leaf in leaves(World))
    rows = [
        [code(name), code(entry.name), entry.unit, entry.meaning]
        for name, _, kind in parts(World)
        for entry in islice(entries, width(kind) if hasattr(kind, "_fields") else 1)
    ]
    return rows_table(["Field", "Number", "Unit", "Meaning"], rows[first:last])


def gains_table() -> str:
    """Gains of all guiding laws, as the classes of the laws declare them."""
    declared = {law.__name__: {item.name: item for item in fields(law)} for law in LAWS}
    rows = (gain_row(name, declared) for name in Gains._fields)
    return rows_table(["Name", "Unit", "Controllers", "Provenance"], rows)


def gain_row(name: str, declared: Mapping[str, Mapping[str, Field[Any]]]) -> list[str]:
    """Unit, controllers and provenance of a gain."""
    having = {law: items[name].metadata for law, items in declared.items() if name in items}
    first = next(iter(having.values()))
    return [code(name), first["unit"], ", ".join(map(code, having)), first["provenance"]]


def tables() -> dict[str, str]:
    """Content of each block of the page."""
    return {
        "observation": observation_table(),
        "context": context_table(),
        "telemetry": entries_table(TELEMETRY),
        "reward": fields_table(RewardWeights),
        "task": fields_table(PathFollowing),
        "starts": fields_table(Starts),
        "sensing": fields_table(Sensing),
        "stored by every world": world_table(0, BASIC_ROWS),
        "stored by some worlds": world_table(BASIC_ROWS, STORED_ROWS),
        "constants": world_table(STORED_ROWS, STORED_ROWS + CONSTANT_ROWS),
        "memory": entries_table(layout_of(Memory)),
        "nominal": entries_table(layout_of(Nominal)),
        "gains": gains_table(),
    }


def main() -> None:
    """Write the tables of observation, telemetry, reward, task, world and laws."""
    for name, content in tables().items():
        write_block(PAGE, name, content)


if __name__ == "__main__":
    tyro.cli(main)
