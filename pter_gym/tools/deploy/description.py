"""The description of a Functional Mock-up Unit: its variables and what it can do, as XML."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from pter_gym._version import __version__

Causality = Literal["input", "parameter", "output"]

CATEGORIES = ("logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError")

BASE_UNITS = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    **{name: {name: 1} for name in ("kg", "m", "s", "rad")},
}
"""Exponents of SI base units."""


@dataclass(frozen=True)
class Variable:
    """A variable: an input or a parameter with its bounds, or an output.

    Attributes
    ----------
    whole
        Whether it is a whole number.
    direct
        Whether an output depends on the inputs at once.
    """

    name: str
    causality: Causality
    unit: str
    meaning: str
    start: float
    least: float = 0.0
    most: float = 0.0
    whole: bool = False
    direct: bool = False


def written_unit(unit: str) -> str:
    """Return a unit as Modelica writes it."""
    return unit.replace("·", ".").replace("²", "2")


def exponents(unit: str) -> dict[str, int]:
    """Return the exponents of SI base units in a unit such as N·s/m or m/s²."""
    total: dict[str, int] = {}
    above, _, below = unit.partition("/")
    for sign, part in ((1, above), (-1, below)):
        for symbol, power in re.findall(r"([A-Za-z]+)(²?)", part):
            for base, exponent in BASE_UNITS[symbol].items():
                total[base] = total.get(base, 0) + sign * exponent * (2 if power else 1)
    return total


def description(
    title: str,
    identifier: str,
    token: str,
    variables: Sequence[Variable],
    period: float,
    units: Sequence[str],
    version: str,
) -> str:
    """Return ``modelDescription.xml``.

    ``token`` is that of the compiled unit, ``period`` its control period [s], and ``units`` are the
    source files that are compiled.
    """
    older = version == "2.0"
    state = "FMUstate" if older else "FMUState"
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": identifier,
            "guid" if older else "instantiationToken": token,
            "description": title,
            "generationTool": f"pter_gym {__version__}",
            "variableNamingConvention": "structured",
        },
    )
    step = {} if older else {"fixedInternalStepSize": repr(period)}
    unit = SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": identifier,
            "canHandleVariableCommunicationStepSize": "true",
            f"canGetAndSet{state}": "true",
            f"canSerialize{state}": "true",
            **step,
        },
    )
    if older:
        sources = SubElement(unit, "SourceFiles")
        for name in units:
            SubElement(sources, "File", name=name)
    _write_units(root, variables)
    categories = SubElement(root, "LogCategories")
    for name in CATEGORIES:
        SubElement(categories, "Category", name=name)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="4", stepSize=repr(period))
    ordered = [each for whole in (False, True) for each in variables if each.whole == whole]
    (_write_variables_2 if older else _write_variables_3)(root, ordered)
    return _text(root)


def build_description(identifier: str, units: Sequence[str], flags: Sequence[str]) -> str:
    """Return ``buildDescription.xml`` of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = SubElement(build, "SourceFileSet", language="C99", compilerOptions=" ".join(flags))
    for name in units:
        SubElement(files, "SourceFile", name=name)
    return _text(root)


def _text(root: Element) -> str:
    ET.indent(root)
    return ET.tostring(root, "unicode", xml_declaration=True) + "\n"


def _write_units(root: Element, variables: Sequence[Variable]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(each.unit for each in variables if each.unit != "1"):
        entry = SubElement(definitions, "Unit", name=written_unit(unit))
        SubElement(entry, "BaseUnit", {name: str(n) for name, n in exponents(unit).items() if n})


def _common(variable: Variable, reference: int) -> dict[str, str]:
    common = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.meaning,
        "causality": variable.causality,
    }
    return common | ({"variability": "fixed"} if variable.causality == "parameter" else {})


def _numbers(variable: Variable) -> dict[str, str]:
    unit = {} if variable.unit == "1" else {"unit": written_unit(variable.unit)}
    if variable.causality == "output":
        return unit
    of = int if variable.whole else float
    bounds = {"min": variable.least, "max": variable.most, "start": variable.start}
    return unit | {name: repr(of(value)) for name, value in bounds.items()}


def _inputs(variables: Sequence[Variable], variable: Variable, first: int) -> str:
    """Return the references of what an output depends on at once."""
    numbers = (k for k, each in enumerate(variables, first) if each.causality == "input")
    return " ".join(map(str, numbers)) if variable.direct else ""


def _write_variables_3(root: Element, variables: Sequence[Variable]) -> None:
    listed = SubElement(root, "ModelVariables")
    SubElement(
        listed,
        "Float64",
        name="time",
        valueReference=str(len(variables)),
        description="time of the simulation",
        causality="independent",
        variability="continuous",
    )
    structure = SubElement(root, "ModelStructure")
    for reference, variable in enumerate(variables):
        kind = "Int32" if variable.whole else "Float64"
        SubElement(listed, kind, {**_common(variable, reference), **_numbers(variable)})
        if variable.causality == "output":
            depends = _inputs(variables, variable, 0)
            SubElement(structure, "Output", valueReference=str(reference), dependencies=depends)
    for reference, variable in enumerate(variables):
        if variable.causality == "output":
            SubElement(structure, "InitialUnknown", valueReference=str(reference))


def _write_variables_2(root: Element, variables: Sequence[Variable]) -> None:
    listed = SubElement(root, "ModelVariables")
    structure = SubElement(root, "ModelStructure")
    outputs, initial = (SubElement(structure, name) for name in ("Outputs", "InitialUnknowns"))
    for reference, variable in enumerate(variables):
        scalar = SubElement(listed, "ScalarVariable", _common(variable, reference))
        SubElement(scalar, "Integer" if variable.whole else "Real", _numbers(variable))
        if variable.causality == "output":
            place, depends = str(reference + 1), _inputs(variables, variable, 1)
            SubElement(outputs, "Unknown", index=place, dependencies=depends)
            SubElement(initial, "Unknown", index=place)
