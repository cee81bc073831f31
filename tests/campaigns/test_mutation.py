"""The campaign of faults: its operators, its list of equal faults, and a run on a small package."""

from pathlib import Path

import pytest

from campaigns import mutation
from campaigns.choosing import Case, choose
from campaigns.mutants import mutants_of

FOLDER = Path(mutation.__file__).parent


def changes(source: str) -> list[str]:
    return [mutant.change for mutant in mutants_of("file.py", source)]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("y = a + b", ["a + b → a - b"]),
        ("y = a < b", ["a < b → a <= b", "a < b → a >= b"]),
        ("y = a <= x < b", ["a <= x < b → a < x < b", "a <= x < b → a > x < b"]),
        ("y = not a", ["not a → a"]),
        ("y = -a", ["-a → a"]),
        ("y = True", ["True → False"]),
        ("y = 2.5", ["2.5 → 3.5"]),
        ("y = min(a, b)", ["min → max"]),
        ("y = abs(a)", ["abs(a) → a"]),
        ("y += a", ["y += a → y -= a"]),
        ("a.b = c", ["a.b = c → pass"]),
        ("a.append(b)", ["a.append(b) → pass"]),
        ("raise ValueError(1 + 2)", ["raise ValueError(1 + 2) → pass"]),
        ("if a: b = c", ["a → not a"]),
        ("y = b if a else c", ["a → not a"]),
    ],
)
def test_each_operator(source: str, expected: list[str]):
    found = changes(source)
    assert set(expected) <= set(found)


@pytest.mark.parametrize(
    "source",
    [
        '"""A text of 1 + 2."""',
        "import a",
        "def f(x: int | None) -> int | None: return x",
        "assert a",
        "class A:\n    def __repr__(self): return 1 + 2",
        "y = f'{a + b}'",
        "print(a)",
        "Alias = int | str",
    ],
)
def test_what_says_nothing_gives_no_fault(source: str):
    assert changes(source) == []


def test_a_change_is_one_place_of_the_text():
    source = "θ = (a +\n     b) * 2  # θ\nz = 1\n"
    found = {mutant.change: mutant for mutant in mutants_of("file.py", source)}
    assert found["a + b → a - b"].source == "θ = ((a - b)) * 2  # θ\nz = 1\n"
    assert found["a + b → a - b"].lines == range(1, 3)


def test_equal_faults_are_there_and_have_reasons():
    equal = mutation.known_equal()
    files = {name.partition(" | ")[0] for name in equal}
    there = {mutant.name for file in files for mutant in mutants_of(file, (mutation.ROOT / file).read_text("utf-8"))}
    assert equal.keys() <= there
    assert all(len(why.split()) > 3 for why in equal.values())


def test_every_pattern_of_a_room_has_files():
    for patterns in mutation.ROOMS.values():
        assert all(list(mutation.ROOT.glob(pattern)) for pattern in patterns)


def test_near_and_quick_tests_of_each_function_come_first():
    (mutant, *_) = mutants_of("p/f.py", "def f(a, b):\n    return a + b\n")
    assert (mutant.lines, mutant.at_import) == (range(2, 3), False)
    names = [("t::a[1]", 0.1, 2), ("t::a[2]", 0.05, 2), ("t::b", 0.2, 2), ("t::c", 0.01, 1), ("u::d", 0.3, 2)]
    cases = [Case(name, seconds, {"p/f.py": frozenset([line])}) for name, seconds, line in names]
    texts = {"t": "", "u": "from p.f import f"}
    assert [case.name for case in choose(mutant, cases, 0.9, texts)] == ["u::d", "t::a[2]", "t::b", "t::a[1]"]
    assert [case.name for case in choose(mutant, cases, 0.1, {})] == ["t::a[2]"]
