"""Which tests run for a fault, and in which order: those that reach it, near and quick ones first."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .mutants import Mutant

BROAD = "tests/conformance/test_traces.py"
"""A test file that looks at all numbers of the simulator: as near to each fault as one that imports its module."""

AHEAD = 8
"""How many further cases of a test function come before one that is a second longer, or before those of the next
nearest files."""


@dataclass(frozen=True)
class Case:
    """A test that passes without the compiler, how long it takes [s], and the lines that it reaches, by file."""

    name: str
    seconds: float
    lines: dict[str, frozenset[int]]


def file_of(test: str) -> str:
    """The file of a test."""
    return test.partition("::")[0]


def function_of(test: str) -> str:
    """The name of a test without its parameters."""
    return test.partition("[")[0]


def choose(mutant: Mutant, cases: list[Case], budget: float, texts: Mapping[str, str]) -> list[Case]:
    """Tests that reach a fault's statement within a budget [s]; what runs on import is reached by all of its module's.

    Tests in the nearest files come first, and quick ones, and of each function the quickest; further ones wait.
    """
    told = {file: min(nearness(mutant, text), 1 if file == BROAD else 3) for file, text in texts.items()}
    found = [case for case in cases if mutant.file in case.lines]
    if not mutant.at_import:
        found = [case for case in found if not case.lines[mutant.file].isdisjoint(mutant.lines)]
    else:
        near = {file for file, place in told.items() if place < 3}
        found = [case for case in cases if mutant.file in case.lines or file_of(case.name) in near] or cases
    rank: Counter[str] = Counter()
    ordered = []
    for case in sorted(found, key=lambda case: case.seconds):
        place = AHEAD * (told.get(file_of(case.name), 3) + case.seconds) + rank[function_of(case.name)]
        ordered.append((place, case.name, case))
        rank[function_of(case.name)] += 1
    chosen, spent = [], 0.0
    for *_, case in sorted(ordered):
        if chosen and spent + case.seconds > budget:
            break
        chosen.append(case)
        spent += case.seconds
    return chosen


def nearness(mutant: Mutant, text: str) -> int:
    """How near a test file is to a fault, by its text: what it imports, and whether it names what has the fault.

    0 with its module and its name, 1 with its module, 2 with its name, 3 else.
    """
    names = mutant.scope.split(".") if mutant.scope else re.findall(r"^\w+(?=: | = )", mutant.line)
    named = any(re.search(rf"\b{name}\b", text) for name in names if not name.startswith("__"))
    module = Path(mutant.file).with_suffix("").parts
    last, package = module[-1], "[.]".join(module[:-1])
    if re.search(rf"\b{package}[.]{last}\b|\bfrom {package} import [^\n]*\b{last}\b", text):
        return 0 if named else 1
    return 2 if named else 3
