"""Every tool can be deleted: without its folder and its tests, the rest passes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pter_gym._commands.main import commands

ROOT = Path(__file__).parents[2]
TOOLS = sorted(path.name for path in (ROOT / "pter_gym" / "tools").iterdir() if (path / "__init__.py").exists())

OFFERING = ("tests/meta", "tests/commands", "tests/tools")
"""What names tools, or tests one; tools know no other tool."""

CORE = ("tests/conformance", "tests/benchmark", "tests/policies")
"""What of the core can use a tool; physics, paths and hands import nothing above them."""

OF_ALL_TOOLS = ("tests/meta/test_docs.py", "tests/meta/test_pages.py")
"""Tests of pages, which speak of all tools."""


def without(tools: list[str], folder: Path) -> Path:
    """Copy the checkout to a folder without some tools."""
    skipped = shutil.ignore_patterns(".*", "__pycache__", "_build", "pter-*", "*.egg-info")
    for name in ("pter_gym", "agents", "tests", "docs", "notebooks"):
        shutil.copytree(ROOT / name, folder / name, ignore=skipped)
    for path in (*ROOT.glob("*.md"), *ROOT.glob("*.toml"), *ROOT.glob("*.txt"), ROOT / "CITATION.cff"):
        shutil.copy(path, folder)
    for tool in tools:
        shutil.rmtree(folder / "pter_gym" / "tools" / tool)
        shutil.rmtree(folder / "tests" / "tools" / tool)
    return folder


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python on the packages in a folder."""
    path = os.pathsep.join([str(folder), str(folder / "agents")])
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )


def test_all_tools_register_what_they_offer():
    modules = {entry.module for entry in commands().values()}
    assert {f"pter_gym.tools.{tool}" for tool in TOOLS} == {
        module.rpartition(".")[0] for module in modules if module.startswith("pter_gym.tools.")
    }


@pytest.mark.parametrize("tool", TOOLS)
def test_commands_of_the_others_work_without_a_tool(tool: str, tmp_path: Path):
    folder = without([tool], tmp_path)
    program = "import pter_gym; from pter_gym._commands.main import *; print(pter_gym.__file__); main(['--help'])"
    shown = python(folder, "-c", program)
    assert shown.stdout.startswith(str(folder)), shown.stderr
    lost = {name for name, entry in commands().items() if entry.module.startswith(f"pter_gym.tools.{tool}.")}
    assert lost
    for name in commands():
        assert (f"  {name} " in shown.stdout) == (name not in lost)


def assert_tests_pass(folder: Path, rooms: tuple[str, ...]) -> None:
    marks = ("-m", "not slow and not long and not agents", *(f"--ignore={file}" for file in OF_ALL_TOOLS))
    outcome = python(
        folder, "-m", "pytest", "-q", "-n", "2", *marks, *(room for room in rooms if (folder / room).exists())
    )
    assert outcome.returncode == 0, outcome.stdout[-3000:]


@pytest.mark.long
@pytest.mark.parametrize("tool", TOOLS)
def test_the_rest_passes_its_tests_without_a_tool(tool: str, tmp_path: Path):
    assert_tests_pass(without([tool], tmp_path), OFFERING)


@pytest.mark.long
def test_the_core_passes_its_tests_without_any_tool(tmp_path: Path):
    assert_tests_pass(without(TOOLS, tmp_path), CORE)
