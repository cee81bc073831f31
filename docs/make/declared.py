"""Tables of what the code declares: observation, reward, task, world, gains, scores, the standard test."""

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import MISSING, Field, fields
from itertools import islice
from pathlib import Path
from typing import Any, get_args

from pages import IMAGES, table, text_table

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import layout_of, leaves, parts, width
from pter_gym._engine.world import World
from pter_gym.controllers import Impedance, SingleDof, TorqueFeedback, VelocityRatio
from pter_gym.controllers._gains import Gains
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import Sensors
from pter_gym.tasks.path_following._context import TOLD
from pter_gym.tasks.path_following._observation import Observation

LAWS = (Impedance, TorqueFeedback, SingleDof, VelocityRatio)
TESTED = ("impedance", "torque-feedback", "free", "locked", "random")
LONGEST_SCRIPT = 40
"""Most lines of a script that a page shows whole."""


def code(text: str) -> str:
    """Return the text in the font of code."""
    return f"`{text}`"


def entries_table(entries: Layout) -> str:
    """Name, unit and meaning of entries that are stored in their units."""
    return text_table(
        ["Name", "Unit", "Meaning"], ([code(each.name), each.unit, each.meaning] for each in entries.fields)
    )


def observation() -> str:
    """All entries that an observation may contain, and the sensors that bring them."""
    entries = zip(leaves(Observation), layout_of(Observation, BASELINE).fields, strict=True)
    rows = (
        [code(each.name), each.unit, f"{each.scale:g}", each.meaning, brought_by(leaf.entries[0].sensors)]
        for leaf, each in entries
    )
    return text_table(["Name", "Unit", "Scale", "Meaning", "Sensors"], rows)


def brought_by(sensors: tuple[str, ...]) -> str:
    """The sensors that bring an entry."""
    return "all" if sensors == get_args(Sensors) else ", ".join(map(code, sensors))


def context() -> str:
    """What an observation may tell of machine and task."""
    rows = ([code(each.name), each.unit, f"{each.scale:g}", each.meaning] for each in TOLD.fields)
    return text_table(["Name", "Unit", "Scale", "Meaning"], rows)


def fields_table(kind: Any) -> str:
    """Every field of a dataclass of parameters with unit, default and provenance."""
    rows = (
        [code(item.name), item.metadata["unit"], default(item), item.metadata["provenance"]] for item in fields(kind)
    )
    return text_table(["Name", "Unit", "Default", "Provenance"], rows)


def default(item: Field[Any]) -> str:
    """The default of a field: a number or several, the class of a default record, or the names of several."""
    if item.default is MISSING:
        return "none"
    if isinstance(item.default, tuple):
        return ", ".join(getattr(each, "name", None) or f"{each:g}" for each in item.default)
    return f"{item.default:g}" if isinstance(item.default, (int, float)) else code(f"{type(item.default).__name__}()")


def world_table(first: int, last: int) -> str:
    """Rows of a world by the field of ``World`` that holds them."""
    entries = (leaf.field(BASELINE) for leaf in leaves(World))
    rows = [
        [code(name), code(entry.name), entry.unit, entry.meaning]
        for name, _, kind in parts(World)
        for entry in islice(entries, width(kind) if hasattr(kind, "_fields") else 1)
    ]
    return text_table(["Field", "Number", "Unit", "Meaning"], rows[first:last])


def gains() -> str:
    """Gains of all guiding laws, as the classes of the laws declare them."""
    declared = {law.__name__: {item.name: item.metadata for item in fields(law)} for law in LAWS}

    def row(name: str) -> Iterable[str]:
        having = {law: items[name] for law, items in declared.items() if name in items}
        first = next(iter(having.values()))
        return code(name), first["unit"], ", ".join(map(code, having)), first["provenance"]

    return text_table(["Name", "Unit", "Controllers", "Provenance"], map(row, Gains._fields))


def scores() -> str:
    """Every score of an episode with its unit and meaning."""
    from pter_gym.benchmark.metrics import METRICS

    rows = ([code(name), each.unit, each.meaning] for name, each in METRICS.items())
    return text_table(["Score", "Unit", "Meaning"], rows)


def standard_test() -> str:
    """The paper's standard test at the manufacturer's time constant, seed 0."""
    from pter_gym.benchmark import find_policy, run_standard_test

    policies = {name: find_policy(name, scenario=None) for name in TESTED}
    result = run_standard_test(policies, time_constants=[BASELINE.clutch.time_constant])
    rows: list[list[str]] = []
    for name, (run,) in result.runs.items():
        score = run.score
        numbers = f"{1000 * score.path_error_m:,.1f} {score.mean_speed_m_s:.2f} {score.peak_acceleration_m_s2:.1f}"
        rows.append([code(name), *numbers.split(), "yes" if score.completed else "no", f"{score.duration_s:.2f}"])
    head = ["path error [mm]", "mean speed [m/s]", "peak tip acceleration [m/s²]", "at the end of the path", "time [s]"]
    return table(["Policy", *head], rows)


def claims() -> str:
    """How many claims of the paper are met, and how, in the run that the page of its figures shows."""
    stored = json.loads((IMAGES / "paper" / "claims.json").read_text("utf-8"))
    count = Counter(each["kind"] for each in stored)
    return (
        f"`pter reproduce` makes the paper's figures and table, and checks {len(stored)} of its claims:\n"
        f"{count['prediction']} are predictions that hold, {count['calibration']} hold because parameters were fitted\n"
        f"to them, {count['construction']} follow from how the model is built, and {count['not met']} are "
        "[not met](docs/reproduction.md).\n"
    )


def script(path: Path) -> str:
    """A script as pages show it: all of it, or its last function if it is long."""
    text = path.read_text("utf-8")
    if path.parent.name == "stock" and len(text.splitlines()) > LONGEST_SCRIPT:
        text = text[text.rindex("\n\n\ndef ") + 3 :]
    return f"```python\n{text}```\n"
