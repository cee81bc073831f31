"""How the numbers of the paper's study were found, and what else would do: docs/calibration.md and reproduction.md.

    for w in 0 0.1 0.3 1; do pter fit --trends $w --out FOLDER/$w.toml; done      # half an hour of one core
    python docs/make/calibration.py FOLDER

Every preset in FOLDER is a row of the front and counts in the ranges of the values.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from pages import put_block, signed, table

from pter_gym.params._preset import PRESET, Preset, load_preset
from pter_gym.tools.paper.experiments.calibration import READINGS, SPACE, TARGET, quality_of, setup_of, table_of
from pter_gym.tools.paper.experiments.claims import COLUMNS, NAMES, STATEMENTS, check
from pter_gym.tools.paper.experiments.setup import STUDY, values_of
from pter_gym.tools.paper.experiments.study import Study

PAGE = "docs/calibration.md"
SHOWN = {
    "arm": ("length_a", "length_b", "inertia_a", "inertia_b", "coupling"),
    "clutch": ("breakaway_ratio",),
    "delrin": ("dynamic_scale", "breakaway_ratio", "mu_dynamic_present"),
    "path": ("length",),
    "hand": ("push", "force_max"),
    "controller": ("stiffness",),
}
"""Values whose ranges are shown, by section."""


def percent(deviation: float, digits: int = 1) -> str:
    """Return a relative deviation in percent."""
    return signed(f"{100.0 * deviation:+.{digits}f}")


def off(preset: Preset, parts: int = 1) -> NDArray[np.float64]:
    """Return the relative deviation of each entry of Table I, (3, 3)."""
    return table_of(preset, parts=parts) / TARGET - 1.0


def entries() -> str:
    """Table I with the study's numbers, and with those of the scenarios."""
    sets = {"the study": off(STUDY), "the scenarios": off(PRESET)}
    rows = [
        [name, *(f"{percent(value)} %" for found in sets.values() for value in found[k])]
        for k, name in enumerate(NAMES.values())
    ]
    return table(["Clutch", *(f"{name}, {column}" for name in sets for column, _ in COLUMNS)], rows)


def front(presets: dict[str, Preset]) -> str:
    """The trade-off of Table I and the trends."""
    rows: list[list[str]] = []
    for name, preset in presets.items():
        found = quality_of([setup_of(preset)])
        deviation = found.table[0] / TARGET - 1.0
        moved = np.abs((1.0 + off(preset, parts=10)) / (1.0 + deviation) - 1.0).max()
        rows.append(
            [
                f"{name} (shipped)" if preset == STUDY else name,
                f"{100.0 * np.abs(deviation).max():.1f} %",
                f"{100.0 * np.sqrt((deviation**2).mean()):.1f} %",
                ", ".join(signed(f"{value:.2f}") for value in found.trends[0]),
                f"{100.0 * moved:.1f} %",
            ]
        )
    return table(
        ["Search", "Table I, worst entry", "root mean square", "correlations", "a tenth of the substep moves up to"],
        rows,
    )


def choices() -> str:
    """What each open choice does to Table I."""
    rows = [
        [name, *(", ".join(percent(value, 0) for value in row) for row in table_of(STUDY, reading) / TARGET - 1.0)]
        for name, reading in READINGS.items()
    ]
    return table(["Choice", *NAMES.values()], rows, "---")


def ranges(presets: dict[str, Preset]) -> str:
    """How far the found sets are apart."""

    def rows() -> Iterator[list[str]]:
        for section, names in SHOWN.items():
            for name in names:
                found = [values_of(getattr(preset, section))[name] for preset in (*presets.values(), STUDY)]
                unit = getattr(STUDY, section).__dataclass_fields__[name].metadata["unit"]
                shown = (signed(f"{value:.3g}") for value in (found[-1], min(found), max(found)))
                yield [f"`{section}.{name}`{'' if unit == '1' else f' [{unit}]'}", *shown]

    return table(["Value", "shipped", "lowest", "highest"], rows())


def space() -> str:
    """The search space."""
    rows = ([each.name, each.unit, f"{each.low:g} to {each.high:g}", each.reason.replace("|", r"\|")] for each in SPACE)
    return table(["number", "unit", "range", "reason"], rows, "---")


def elsewhere(presets: dict[str, Preset]) -> str:
    """What the claims that nothing was put in for come out as on other machines."""
    statements = [each for each in STATEMENTS if each.how == "prediction"]
    statements += [
        claim.statement for claim in check(Study()) if not claim.holds and claim.statement.how != "prediction"
    ]
    sets = {
        "shipped": STUDY,
        **{name: each for name, each in presets.items() if each != STUDY},
        "the scenarios'": PRESET,
    }
    found = [check(Study(setup_of(preset)), statements) for preset in sets.values()]
    rows = [
        [s.id, s.condition, *(f"{signed(f'{row[k].value:.3g}')}{'' if row[k].holds else ' †'}" for row in found)]
        for k, s in enumerate(statements)
    ]
    return table(["Claim", "holds if", *sets], rows)


def main(fits: tyro.conf.Positional[Path], /, *, write: bool = True) -> None:
    """Fill the tables of the page from the presets in a folder."""
    presets = {
        path.read_text("utf-8").partition("\n")[0].removeprefix("# Found by ").rstrip("."): load_preset(path)
        for path in sorted(fits.glob("*.toml"))
    }
    made = {
        "table": entries(),
        "front": front(presets),
        "choices": choices(),
        "ranges": ranges(presets),
        "space": space(),
    }
    for name, content in made.items():
        put_block(PAGE, name, content, write=write)
    put_block("docs/reproduction.md", "elsewhere", elsewhere(presets), write=write)


if __name__ == "__main__":
    tyro.cli(main)
