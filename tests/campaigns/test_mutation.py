"""The campaign of faults: its operators, its list of equal faults, and a run on a small package."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from campaigns import mutation
from campaigns.mutants import mutants_of

FOLDER = Path(mutation.__file__).parent

CODE = '''\
"""A module."""

LIMIT = 3


def larger(x: int, y: int = 1) -> int:
    """Return the larger one."""
    return x if x > y else y


def unreached(x: int) -> int:
    return x * 2
'''

TESTS = """\
from toy.code import LIMIT, larger

def test_limit():
    assert LIMIT == 3

def test_larger():
    assert larger(2, 1) == 2
    assert larger(1, 2) == 2
"""

DRIVER = """\
import json, sys
from pathlib import Path
import mutation
campaign = mutation.Campaign(Path(sys.argv[1]), Path(sys.argv[2]))
source = (campaign.root / "toy/code.py").read_text()
cases = campaign.measure(["tests/test_toy.py"], ["toy/code.py"], 5.0)
found = mutation.mutants_of("toy/code.py", source)
texts = {"tests/test_toy.py": (campaign.root / "tests/test_toy.py").read_text()}
outcomes = campaign.try_all([(mutant, mutation.choose(mutant, cases, 5.0, texts)) for mutant in found])
print(json.dumps({outcome.mutant.change: [outcome.outcome, outcome.seconds > 0.0] for outcome in outcomes}))
"""


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


@pytest.mark.parametrize("file", ["pter_gym/physics/arm.py", "pter_gym/internal/codec.py"])
def test_faults_of_a_file_compile_and_have_names_of_their_own(file: str):
    source = (mutation.ROOT / file).read_text("utf-8")
    found = mutants_of(file, source)
    assert len({mutant.name for mutant in found}) == len(found) > 20
    for mutant in found:
        compile(mutant.source, file, "exec")
        assert mutant.source != source


def test_equal_faults_are_there_and_have_reasons():
    equal = mutation.known_equal()
    files = {name.partition(" | ")[0] for name in equal}
    there = {mutant.name for file in files for mutant in mutants_of(file, (mutation.ROOT / file).read_text("utf-8"))}
    assert equal.keys() <= there
    assert all(len(why.split()) > 3 for why in equal.values())


def test_every_pattern_of_a_room_has_files():
    for patterns in mutation.ROOMS.values():
        assert all(list(mutation.ROOT.glob(pattern)) for pattern in patterns)


def test_a_share_has_an_interval():
    assert mutation.share(0, 0) == ""
    assert mutation.share(95, 100) == "95.0 (88.8 … 97.8)"


def test_quickest_test_of_each_function_comes_first():
    (mutant, *_) = mutants_of("f.py", "def f(a, b):\n    return a + b\n")
    assert (mutant.lines, mutant.at_import) == (range(2, 3), False)
    names = [("t::a[1]", 0.1, 2), ("t::a[2]", 0.05, 2), ("t::b", 0.2, 2), ("t::c", 0.01, 1)]
    cases = [mutation.Case(name, seconds, {"f.py": frozenset([line])}) for name, seconds, line in names]
    assert [case.name for case in mutation.choose(mutant, cases, 0.9, {})] == ["t::a[2]", "t::b", "t::a[1]"]
    assert [case.name for case in mutation.choose(mutant, cases, 0.1, {})] == ["t::a[2]"]


def test_tests_that_name_a_constant_come_first():
    (mutant, *_) = mutants_of("p/f.py", "LIMIT = 3\n")
    cases = [mutation.Case(name, 1.0, {file: frozenset([1])}) for name, file in (("t::a", "p/f.py"), ("u::b", "g.py"))]
    texts = {"t": "from p.f import LIMITED", "u": "from p.f import LIMIT"}
    assert [case.name for case in mutation.choose(mutant, cases, 9.0, texts)] == ["u::b", "t::a"]
    assert [case.name for case in mutation.choose(mutant, cases, 9.0, {})] == ["t::a"]


@pytest.mark.parametrize(
    ("text", "nearness"),
    [
        ("from p.room.door import load", 0),
        ("from p.room.door import other", 1),
        ("import p.room.door", 1),
        ("from p.room import window, door", 1),
        ("from p import load", 2),
        ("from p.room import doors; loaded()", 3),
    ],
)
def test_the_nearest_tests_name_the_function_or_its_module(text: str, nearness: int):
    (mutant, *_) = mutants_of("p/room/door.py", "def load(x):\n    return x + 1\n")
    assert mutation.nearness(mutant, text) == nearness


@pytest.mark.slow
def test_a_campaign_tells_what_is_killed_survives_or_is_unreached(tmp_path: Path):
    for name, text in {"toy/__init__.py": "", "toy/code.py": CODE, "tests/test_toy.py": TESTS}.items():
        (tmp_path / "root" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "root" / name).write_text(text, "utf-8")
    subprocess.run(["git", "init", "-q", tmp_path / "root"], check=True)
    test = tmp_path / "root/tests/test_toy.py"

    def run() -> dict[str, list[str | bool]]:
        command = [sys.executable, "-c", DRIVER, tmp_path / "root", tmp_path / "work"]
        done = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    first = run()
    assert first == {
        "3 → 4": ["killed", True],
        "1 → 2": ["survived", True],
        "x > y → x >= y": ["survived", True],
        "x > y → x <= y": ["killed", True],
        "x * 2 → x / 2": ["unreached", False],
        "2 → 3": ["unreached", False],
    }
    known = {"3 → 4": ["killed", False], "x > y → x <= y": ["killed", False]}
    assert run() == {**first, **known}, "what is known is not tried again"
    test.write_text("from toy.code import larger\n\ndef test_larger():\n    assert larger(2) == 2\n", "utf-8")
    assert run()["x > y → x <= y"] == ["killed", True], "another test, so it is tried again"
