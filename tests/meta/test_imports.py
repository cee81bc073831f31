"""Two rules: the core imports no tool and goes one way, and a tool imports the core alone.

The front door is light.
"""

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import pter_gym

PACKAGE = Path(pter_gym.__file__).parent

CORE = (
    ("_version", "errors", "units"),
    ("_internal", "_compiled"),
    ("params",),
    ("_physics",),
    ("hands", "paths", "haptics"),
    ("tasks",),
    ("_engine", "scenarios"),
    ("controllers",),
    ("policies",),
    ("envs",),
    ("gradients",),
    ("benchmark",),
    ("_commands",),
)
"""The rooms of the core from the ground up: a room imports those of the rows before its own, and no neighbour."""

LEVEL = {room: level for level, rooms in enumerate(CORE) for room in rooms}

LAWS_MAY_IMPORT = {"pter_gym._engine.law", "pter_gym.tasks.path_following._observation"}
"""All that control laws know of the worlds in which they act: what a law is to the engine, the record that it reads."""

SHARED = "pter_gym.tools.figures"
"""What tools share: the style of all figures."""

COMPOSES = {"pter_gym.tools.device": "pter_gym.tools.tuning"}
"""Which tool may use which other one."""

HEAVY = (
    "matplotlib",
    "numba",
    "pygame",
    "safetensors",
    "scipy",
    "stable_baselines3",
    "torch",
    "tyro",
)


def modules(folder: str = ".") -> list[Path]:
    return sorted((PACKAGE / folder).rglob("*.py"))


def core_modules() -> list[Path]:
    return [path for path in modules() if "tools" not in path.relative_to(PACKAGE).parts]


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str:
    """The room of a dotted module name inside the package: `pter_gym._physics.arm` is in `_physics`."""
    return module.split(".")[1] if "." in module else "__init__"


def tool_of(module: str) -> str:
    """The tool that a module belongs to: `pter_gym.tools.web.site` to `pter_gym.tools.web`."""
    return ".".join(module.split(".")[:3])


def imported_modules(path: Path) -> Iterator[str]:
    """Every module of the package that a file imports, anywhere in it, type-checking blocks included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (
                alias.name for alias in node.names if alias.name.split(".")[0] == PACKAGE.name
            )
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path} has a relative import"
            origin = node.module or ""
            if origin in (PACKAGE.name, f"{PACKAGE.name}.tools"):
                yield from (f"{origin}.{alias.name}" for alias in node.names)
            elif origin.split(".")[0] == PACKAGE.name:
                yield origin


@pytest.mark.parametrize("path", core_modules(), ids=module_of)
def test_the_core_imports_one_way_and_no_tool(path: Path):
    room = room_of(module_of(path))
    if room in ("__init__", "__main__"):
        return
    for imported in imported_modules(path):
        other = room_of(imported)
        assert other in LEVEL, (
            f"{module_of(path)} imports {imported}, which is not a room of the core"
        )
        assert other == room or LEVEL[other] < LEVEL[room], f"{module_of(path)} imports {imported}"


@pytest.mark.parametrize("path", modules("tools"), ids=module_of)
def test_a_tool_imports_the_core_and_no_other_tool(path: Path):
    for imported in imported_modules(path):
        if room_of(imported) == "tools":
            tool = tool_of(module_of(path))
            assert tool_of(imported) in (SHARED, tool, COMPOSES.get(tool)), (
                f"{module_of(path)} imports {imported}"
            )


@pytest.mark.parametrize("path", modules("controllers"), ids=module_of)
def test_laws_know_neither_task_nor_environment(path: Path):
    below = {room for room, level in LEVEL.items() if level < LEVEL["hands"]} | {"controllers"}
    assert {
        module for module in imported_modules(path) if room_of(module) not in below
    } <= LAWS_MAY_IMPORT


def test_nothing_in_the_package_imports_the_agents_or_the_tests():
    for path in modules():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not {name.split(".")[0] for name in names} & {"agents", "pter_agents", "tests"}


def test_modules_import_each_other_in_no_circle():
    """Imports inside functions and for types included."""
    files = {module_of(path): path for path in modules()}

    def imported(path: Path) -> Iterator[str]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                submodules = (f"{node.module}.{alias.name}" for alias in node.names)
                yield from (each if each in files else node.module for each in submodules)

    TopologicalSorter(
        {name: set(imported(path)) - {name} for name, path in files.items()}
    ).prepare()


PUBLIC = [module_of(path) for path in modules() if "__all__" in path.read_text("utf-8")]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_can_be_imported(name: str):
    module = importlib.import_module(name)
    assert not [each for each in module.__all__ if not hasattr(module, each)]


@pytest.mark.parametrize(
    "statement", ["import pter_gym", "import pter_gym; dir(pter_gym); pter_gym.__version__"]
)
def test_import_is_light(statement: str):
    assert not loaded(statement) & set(HEAVY)


def test_environments_load_no_tool_and_no_drawing_code():
    found = loaded(
        "import gymnasium, pter_gym; e = gymnasium.make('PTER/Standard-v0'); e.reset(); e.step(e.action_space.low)"
    )
    assert not found & {"matplotlib", "pygame", "pter_gym.tools"}


def loaded(statement: str) -> set[str]:
    """The packages, and the rooms of this one, that are loaded after a statement."""
    program = f"import sys; {statement}; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    names = result.stdout.split()
    return {name.split(".")[0] for name in names} | {
        ".".join(name.split(".")[:2]) for name in names
    }
