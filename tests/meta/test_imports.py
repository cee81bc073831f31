"""The rooms import one way, and the front door is light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import pter_gym

PACKAGE = Path(pter_gym.__file__).parent

# from the foundation up: a room imports from itself and from the rows before its own, never from its neighbours
ORDER = (
    ("_version", "errors", "units"),
    ("internal", "compiled"),
    ("params",),
    ("physics",),
    ("hands", "paths"),
    ("tasks",),
    ("engine", "scenarios"),
    ("controllers",),
    ("policies", "render"),
    ("envs",),
    ("benchmark",),
    ("datasets", "plots", "tuning"),
    ("identification", "paper", "speed", "web"),
    ("commands",),
    ("__init__", "__main__"),
)
LEVEL = {room: level for level, rooms in enumerate(ORDER) for room in rooms}
LAWS_MAY_IMPORT = {
    "pter_gym._engine.law": "what a law is to the engine",
    "pter_gym.tasks.path_following._observation": "the record that a law reads",
}
"""All that control laws know of the worlds in which they act."""

HEAVY = ("matplotlib", "numba", "pygame", "safetensors", "scipy", "stable_baselines3", "torch", "tyro")


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def room_of(module: str) -> str:
    """The room of a dotted module name inside the package: `pter_gym._physics.arm` is in `physics`."""
    return module.split(".")[1] if "." in module else "__init__"


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_modules(path: Path) -> Iterator[str]:
    """Every module of the package that a file imports, anywhere in it, type-checking blocks included."""
    module = module_of(path)
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == PACKAGE.name)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                above = package.rsplit(".", node.level - 1)[0]
                origin = f"{above}.{origin}".rstrip(".")
            if origin == PACKAGE.name:
                yield from (f"{origin}.{alias.name}" for alias in node.names)
            elif origin.split(".")[0] == PACKAGE.name:
                yield origin


@pytest.mark.parametrize("path", modules(), ids=module_of)
def test_rooms_import_one_way(path: Path):
    room = room_of(module_of(path))
    assert room in LEVEL, f"room {room!r} has no place in the order"
    for imported in imported_modules(path):
        other = room_of(imported)
        assert other in LEVEL, f"{imported} is no room: import names from where they are defined"
        assert other == room or LEVEL[other] < LEVEL[room], f"{module_of(path)} imports {imported}"


@pytest.mark.parametrize("path", sorted((PACKAGE / "controllers").glob("*.py")), ids=module_of)
def test_laws_know_neither_task_nor_environment(path: Path):
    below = {room for rooms in ORDER[: LEVEL["hands"]] for room in rooms} | {"controllers"}
    others = {module for module in imported_modules(path) if room_of(module) not in below}
    assert others <= set(LAWS_MAY_IMPORT)


def test_nothing_in_the_package_imports_the_agents_or_the_tests():
    for path in modules():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not {name.split(".")[0] for name in names} & {"agents", "pter_agents", "tests"}


def test_the_check_sees_a_wrong_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    package = tmp_path / "pter_gym"
    (package / "physics").mkdir(parents=True)
    wrong = package / "physics" / "arm.py"
    wrong.write_text(
        "from ..envs import single\nfrom . import friction\nimport pter_gym.tasks\nfrom pter_gym import commands\n"
    )
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", package)
    assert set(imported_modules(wrong)) == {
        "pter_gym.envs",
        "pter_gym._physics",
        "pter_gym.tasks",
        "pter_gym._commands",
    }


@pytest.mark.parametrize("statement", ["import pter_gym", "import pter_gym; dir(pter_gym); pter_gym.__version__"])
def test_import_is_light(statement: str):
    program = f"import sys; {statement}; print(*sorted({{name.split('.')[0] for name in sys.modules}}))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not set(result.stdout.split()) & set(HEAVY)


def test_import_registers_the_environment():
    program = "import gymnasium, pter_gym; print(gymnasium.spec('PTER/PathFollowing-v0').entry_point)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.startswith("pter_gym.")
