"""Controllers with the shipped gains that ``pter tune`` found on training draws.

``pter_gym/presets/tuned.toml`` has a table for each scenario, controller and pace: the tuned gains, the defaults of
all others, the search command, and scores on training draws that the search had not seen.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.reading import MOST_TOML, parse_toml, read_text, reading
from pter_gym.controllers import CONTROLLERS, Guided, PaceSchedule
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies._stored_gains import make_guided
from pter_gym.scenarios import PACES

TABLE = Path(__file__).parents[1] / "presets" / "tuned.toml"

SUFFIX = "-tuned"

FALLBACK = "everything"
"""The scenario whose gains serve where there are none for another."""

TUNABLE: tuple[str, ...] = tuple(name for name, kind in CONTROLLERS.items() if issubclass(kind, Guided))
"""Names of the controllers that have gains."""

TUNED = tuple(name + SUFFIX for name in TUNABLE)
"""Names under which they are found with tuned gains."""

Table = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]


def find_tuned(name: str, scenario: str | None = None, *, path: FilePath = TABLE) -> PaceSchedule:
    """Return a controller whose tuned gains follow the commanded pace.

    Parameters
    ----------
    name
        Such as ``torque-feedback-tuned``.
    scenario
        Scenario whose gains to use; by default, or if there are none for it, those of ``everything``.
    path
        File of the gains.

    Raises
    ------
    ParameterError
        If there is no such controller, or no gains for it.
    DataError
        If the file is not as ``pter tune`` writes it.
    """
    if name not in TUNED:
        raise unknown_name("policies", name, TUNED)
    controller, path = name.removesuffix(SUFFIX), find_path("path", path)
    table = read_table(path)
    for place in (scenario or FALLBACK, FALLBACK):
        if entries := table.get(place, {}).get(controller):
            knots = [(PACES[pace], controller_of(controller, entry, path)) for pace, entry in entries.items()]
            return PaceSchedule(tuple(sorted(knots, key=lambda knot: knot[0])))
    raise ParameterError(
        f"policies: there are no tuned gains of {controller!r} for {scenario or FALLBACK!r} or {FALLBACK!r}; "
        f"`pter tune {controller}` finds some"
    )


def read_table(path: FilePath = TABLE) -> Table:
    """Return the tuned gains by scenario, controller and pace; empty if there is no file.

    Raises
    ------
    DataError
        If the file cannot be read, names an unknown controller or pace, or does not hold tables.
    """
    path = find_path("path", path)
    with reading(f"tuned gains {path} cannot be read"):
        table = parse_toml(read_text(path, MOST_TOML)) if path.exists() else {}
        for scenario, controllers in table.items():
            for controller, paces in controllers.items():
                for pace, entry in paces.items():
                    if controller not in TUNABLE or pace not in PACES or not isinstance(entry["gains"], dict):
                        raise ValueError(f"{scenario}.{controller}.{pace} must hold gains of a controller at a pace")
    return table


def controller_of(name: str, entry: Mapping[str, Any], path: Path) -> Guided:
    """Return a controller with the gains of an entry; unnamed gains take the defaults stored with it.

    Raises
    ------
    DataError
        If a gain is unknown or refused.
    """
    with reading(f"tuned gains {path}"):
        return make_guided(name, {**entry.get("defaults", {}), **entry["gains"]})
