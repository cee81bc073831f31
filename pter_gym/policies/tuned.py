"""Control laws with shipped gains: tuned ones, and the paper's with a damper for each pace.

``presets/tuned.toml`` has a table for each scenario, law and pace: the gains that ``pter tune``
found on training episodes, the defaults of all others, the search command, and scores on episodes
that the search had not seen. ``presets/dampers.toml``, by ``docs/make/store.py dampers``, has
the damper along the path with which the paper's gains, made for about 0.5 m/s, keep a commanded
pace on a scenario's training episodes.
"""

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

from pter_gym import controllers
from pter_gym._internal.codec import tuple_of
from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.reading import read_toml, reading
from pter_gym.controllers._names import LAWS
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.policies._files import interface_codec
from pter_gym.scenarios.paces import find_pace

if TYPE_CHECKING:
    from pter_gym.controllers import Controller, Guided, PaceSchedule, Scaled

TABLE = Path(__file__).parents[1] / "presets" / "tuned.toml"

DAMPERS = TABLE.with_name("dampers.toml")

SUFFIX = "-tuned"

SCALED = "single-dof-scaled"
"""Name of the law whose gains follow the numbers of a device."""

SCALED_TABLE = TABLE.with_name("scaled.toml")

NEAREST = MappingProxyType({"tremor": "hands", "corridor": "standard", "wall": "standard"})
"""The scenario whose gains serve where there are none for another, chosen on training episodes."""

FALLBACK = "everything"
"""The scenario whose gains serve where there are none for that one either."""

HOLD = 1e-6
"""Part of a pace about it in which its damper holds: far more than a float32 rounds."""

GainsTable = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]


@cache
def tuned_policies() -> tuple[str, ...]:
    """Return the names under which laws are found with shipped gains."""
    return (*tuned_names(read_toml(TABLE, "tuned gains")), SCALED)


def tuned_names(table: Mapping[str, Mapping[str, object]]) -> tuple[str, ...]:
    """Return the names under which laws are found with the gains of a table."""
    there = {name for laws in table.values() for name in laws}
    return tuple(f"{name}{SUFFIX}" for name in LAWS if name in there)


def find_tuned(
    name: str, scenario: str | None = None, *, path: FilePath = TABLE
) -> "PaceSchedule | Scaled":
    """Return a law, such as ``impedance-tuned``, whose gains follow the commanded pace.

    Those of ``single-dof-scaled`` follow the machine too, and are the same in all scenarios.

    Parameters
    ----------
    name, path
        Its name, and the file of the gains.
    scenario
        Scenario whose gains to use, or if there are none for it, those of the nearest one in
        ``NEAREST``; by default, and for one's own, those of ``everything``.

    Raises
    ------
    ParameterError
        If there is no such law, or no gains for it.
    DataError
        If the file is not as ``pter tune`` writes it.
    """
    if name == SCALED:
        return find_scaled()
    controller, path = name.removesuffix(SUFFIX), expand_path("path", path)
    table = read_gains(path)
    if name not in (names := tuned_names(table)):
        raise unknown_name("policies", name, names)
    for place in places_of(scenario):
        if entries := table.get(place, {}).get(controller):
            return _schedule(
                (pace, controller_of(controller, entry, path)) for pace, entry in entries.items()
            )
    raise ParameterError(
        f"policies: there are no tuned gains of {controller!r} for "
        f"{' or '.join(map(repr, places_of(scenario)))}; `pter tune {controller}` finds some"
    )


def places_of(scenario: str | None) -> list[str]:
    """Return the scenarios whose gains serve for one, the best first."""
    return list(dict.fromkeys(filter(None, (scenario, NEAREST.get(scenario or ""), FALLBACK))))


def read_tuned(path: FilePath, scenario: str | None = None) -> "PaceSchedule":
    """Return the law in a file of ``pter tune --out``, with the gains for a scenario.

    Raises a ParameterError if it does not exist or has several laws, a DataError if it is
    another kind of file.
    """
    path = expand_path("policies", path)
    if not path.is_file():
        raise ParameterError(f"policies must name a file that exists, there is no {str(path)!r}")
    table = read_gains(path)
    places = [scenario] if scenario is not None and scenario in table else list(table)
    entries = [(name, place) for place in places for name in table[place]]
    if len(entries) != 1:
        names = ", ".join(f"{name} for {place}" for name, place in entries) or "none"
        raise ParameterError(
            f"policies must name a file with gains of one law, {str(path)!r} has {names}"
        )
    ((name, place),) = entries
    return _schedule(
        (pace, controller_of(name, entry, path)) for pace, entry in table[place][name].items()
    )


def find_paced(name: str, scenario: str | None) -> "Controller":
    """Return a law by its name, with a damper for each pace where there are some."""
    controller = controllers.CONTROLLERS[name]()
    tables = (damping_table().get(place, {}) for place in places_of(scenario) if scenario)
    dampers = next((table[name] for table in tables if name in table), None)
    if not dampers or not isinstance(controller, controllers.Impedance):
        return controller
    laws = (
        (pace, replace(controller, damping_tangential=damping)) for pace, damping in dampers.items()
    )
    return _schedule(laws, hold=HOLD)


@cache
def damping_table() -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    """Return the damper along the path [N·s/m] by scenario, law and pace."""
    return read_toml(DAMPERS, "dampers")


def read_gains(path: FilePath = TABLE) -> GainsTable:
    """Return the tuned gains by scenario, law and pace; empty if there is no file.

    Raises a DataError if it cannot be read, names an unknown law or pace, does not hold tables, or
    mixes machines or paths under the name of a scenario.
    """
    path = expand_path("path", path)
    with reading(f"tuned gains {path} cannot be read"):
        table = read_toml(path, "tuned gains") if path.exists() else {}
        for scenario, controllers in table.items():
            for controller, paces in controllers.items():
                for pace, entry in paces.items():
                    if (
                        controller not in guided()
                        or not find_pace(pace)
                        or not isinstance(entry["gains"], dict)
                    ):
                        raise ValueError(
                            f"{scenario}.{controller}.{pace} must hold gains of a law at a pace"
                        )
            entries = [entry for paces in controllers.values() for entry in paces.values()]
            if len({str(entry.get("digest", "")) for entry in entries}) > 1:
                raise ValueError(f"{scenario} must hold gains for the same machines and paths")
    return table


def controller_of(name: str, entry: Mapping[str, Any], path: Path) -> "Guided":
    """Return a law with the gains of an entry, or raise a DataError if one is wrong.

    Unnamed gains take the defaults stored with it.
    """
    with reading(f"tuned gains {path}"):
        return with_gains(name, {**entry.get("defaults", {}), **entry["gains"]})


def guided() -> "dict[str, type[Guided]]":
    """Return the laws that have gains, by name."""
    laws = controllers.CONTROLLERS.items()
    return {name: kind for name, kind in laws if issubclass(kind, controllers.Guided)}


def with_gains(name: str, gains: Mapping[str, Any]) -> "Guided":
    """Return a guiding law by its name; unnamed gains take their defaults.

    Raises
    ------
    ParameterError
        If there is no such law or gain (the nearest is suggested), or a gain is rejected.
    """
    laws = guided()
    if name not in laws:
        raise unknown_name("law", name, laws)
    names = [item.name for item in fields(laws[name])]
    for gain in gains:
        if gain not in names:
            raise ParameterError(
                f"{name} has no gain {gain!r}: {unknown_name('gains', gain, names)}"
            )
    return laws[name](**{gain: tuple_of(value) for gain, value in gains.items()})


def find_scaled() -> "Scaled":
    """Return single-dof with gains for any device."""
    return cast("Scaled", interface_codec().from_plain(read_toml(SCALED_TABLE, "scaled")))


def _schedule(laws: "Iterable[tuple[str, Guided]]", **options: Any) -> "PaceSchedule":
    """Return laws given by the names of their paces as one."""
    knots = ((find_pace(pace), law) for pace, law in laws)
    return controllers.PaceSchedule(tuple(sorted(knots, key=lambda knot: knot[0])), **options)
