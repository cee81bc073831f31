"""Imports go one way, the core imports no tool, and a tool imports the core alone.

The front door is light.
"""

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from graphlib import TopologicalSorter
from itertools import chain
from pathlib import Path

import pytest

import pter_gym
from near import guide, named_for

PACKAGE = Path(pter_gym.__file__).parent

CORE = (
    ("_version", "errors", "units"),
    ("_internal", "_compiled", "plugins"),
    ("params",),
    ("_physics",),
    ("hands", "paths", "haptics"),
    ("tasks",),
    ("_engine", "scenarios"),
    ("controllers",),
    ("policies",),
    ("benchmark",),
    ("envs",),
    ("gradients",),
    ("_commands",),
)
"""Rooms of the core from the ground up: a room imports those of earlier rows, and no neighbour.

A module that is named here is a room of its own.
"""

LEVEL = {room: level for level, rooms in enumerate(CORE) for room in rooms}

LAWS_MAY_IMPORT = {
    "pter_gym.tasks.path_following._actions",
    "pter_gym.tasks.path_following._observation",
}
"""All that control laws know of the worlds in which they act."""

SHARED = ("pter_gym.tools.figures", "pter_gym.tools.palette")
"""What tools share: the style of all figures, and its colours."""

COMPOSES = {
    "pter_gym.tools.device": "pter_gym.tools.tuning",
    "pter_gym.tools.deploy": "pter_gym.tools.web",  # whose module an FMU is
}
"""Which tool may use which other one."""

HEAVY = {"matplotlib", "numba", "pygame", "safetensors", "scipy", "stable_baselines3", "torch"}

MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}


def imports_of(name: str) -> Iterator[str]:
    """Every module that a module imports, anywhere in it, type-checking blocks included."""
    for node in ast.walk(ast.parse(MODULES[name].read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{name} has a relative import"
            members = (f"{node.module}.{alias.name}" for alias in node.names)
            yield from (member if member in MODULES else str(node.module) for member in members)


IMPORTS = {name: set(imports_of(name)) - {name} for name in MODULES}


def room_of(module: str) -> str:
    """The room of a module of the package: `pter_gym._physics.arm` is in `_physics`."""
    within = module.partition(".")[2]
    return within if within in LEVEL else within.partition(".")[0] or "__init__"


def tool_of(module: str) -> str:
    """The tool of a module: `pter_gym.tools.web` of `pter_gym.tools.web.site`."""
    return ".".join(module.split(".")[:3])


def may_import(module: str, imported: str) -> bool:
    """Return whether a module of the package may import another one."""
    room, other = room_of(module), room_of(imported)
    if room in ("__init__", "__main__"):
        return True
    if room == "tools":
        own = (*SHARED, tool_of(module), COMPOSES.get(tool_of(module)))
        return other != "tools" or tool_of(imported) in own
    if room == "controllers" and LEVEL.get(other, 0) >= LEVEL["hands"] and other != room:
        return imported in LAWS_MAY_IMPORT
    return other in LEVEL and (other == room or LEVEL[other] < LEVEL[room])


def test_imports_go_one_way() -> None:
    within = {name: {each for each in IMPORTS[name] if each in MODULES} for name in MODULES}
    wrong = [(a, b) for a, imported in within.items() for b in imported if not may_import(a, b)]
    assert not wrong
    TopologicalSorter(within).prepare()  # raises where imports form a circle
    outside = {each.split(".")[0] for imported in IMPORTS.values() for each in imported}
    assert not outside & {"agents", "pter_agents", "tests"}


@pytest.mark.agents
def test_every_public_name_can_be_imported() -> None:
    for name, path in MODULES.items():
        module = importlib.import_module(name) if "__all__" in path.read_text("utf-8") else None
        for public in getattr(module, "__all__", ()):
            assert f"{name}.{public}" in MODULES or hasattr(module, public), public


STEP = """
import gymnasium, pter_gym
env = gymnasium.make("PTER/Standard-v0")
env.reset()
env.step(env.action_space.low)
"""


@pytest.mark.parametrize(
    ("statement", "unwanted"),
    [
        ("import pter_gym; dir(pter_gym); pter_gym.__version__", HEAVY | {"tyro"}),
        (STEP, {"matplotlib", "pygame", "pter_gym.tools"}),
    ],
    ids=["import", "step"],
)
def test_what_is_not_needed_is_not_loaded(statement: str, unwanted: set[str]) -> None:
    command = [sys.executable, "-c", f"{statement}\nimport sys; print(*sys.modules)"]
    modules = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert not unwanted & ({*modules} | {name.split(".")[0] for name in modules})


def test_every_file_of_the_core_has_its_tests_in_the_guide() -> None:
    files = {path.relative_to(PACKAGE).with_suffix("").as_posix() for path in MODULES.values()}
    files -= {each for each in files if each.startswith("tools/") or each.endswith("__")}
    named, tests = zip(*guide(), strict=True)
    assert {each for each in files if any(fnmatch(each, name) for name in named)} == files - {
        "_version"
    }
    for test in {each.replace("NAME", "web") for each in chain(*tests)}:
        assert (PACKAGE.parent / "tests" / test).exists(), test


@pytest.mark.parametrize(
    ("file", "tests"),
    [
        ("pter_gym/benchmark/cells.py", {"benchmark/test_tables.py"}),
        ("pter_gym/_engine/hand.py", {"verification/test_task.py"}),
        (
            "pter_gym/envs/_vector.py",
            {
                f"conformance/test_{name}.py"
                for name in ("gymnasium", "arguments", "faults", "history")
            },
        ),
        ("pter_gym/tools/hil/line.py", {"tools/hil"}),
        ("agents/pter_agents/ppo.py", {"agents"}),
        ("docs/scoring.md", {"meta"}),
        ("pter_gym/hands/__init__.py", {"meta"}),
        ("tests/benchmark/test_tables.py", {"benchmark/test_tables.py"}),
        ("benchmarks/throughput.py", set[str]()),
    ],
)
def test_the_guide_finds_the_tests_of_a_file(file: str, tests: set[str]) -> None:
    assert named_for(file) == tests
