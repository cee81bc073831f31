"""What the documents promise exists: commands, links, the example, units and provenance of every parameter."""

import dataclasses
import inspect
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from safetensors.numpy import load_file

from documents import EXTENDING, blocks_of, run_extending, run_policies
from pter_gym import params
from pter_gym.benchmark.leaderboard import leaderboards
from pter_gym.benchmark.tuned import TABLE
from pter_gym.params.preset import PRESET, format_preset
from pter_gym.policies import SHIPPED, read_policy, write_policy
from pter_gym.scenarios import PACES, SCENARIOS

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
PARAMETER_CLASSES = [item for _, item in inspect.getmembers(params, dataclasses.is_dataclass) if inspect.isclass(item)]


def fenced(marker: str, language: str) -> str:
    """The one code block below an HTML comment of the README."""
    blocks = re.findall(
        rf"^<!-- {marker} -->\n```{language}\n(.*?)^```$", README.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    assert len(blocks) == 1
    return blocks[0]


@pytest.mark.parametrize("name", ["benchmark", "tests"])
def test_readme_command_is_one_line_with_tested_versions(name: str):
    command = fenced(f"command: {name}", "sh")
    assert command.count("\n") == 1
    assert command.startswith("python3 -m venv --without-pip .venv && ")
    assert "-c constraints.txt" in command


def test_readme_benchmark_command_needs_the_core_only():
    assert "[" not in fenced("command: benchmark", "sh")


@pytest.mark.slow
@pytest.mark.agents
def test_readme_example_runs(capsys: pytest.CaptureFixture[str]):
    """As it stands, but with fewer steps."""
    pytest.importorskip("stable_baselines3")
    code = fenced("example", "python")
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    assert code.count("3_000_000") == 1
    exec(compile(code.replace("3_000_000", "20_000"), str(README), "exec"), {})
    assert "torque-feedback" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.agents
def test_the_agent_of_the_readme_beats_the_paper() -> None:
    """At each pace."""
    pytest.importorskip("stable_baselines3")
    names: dict[str, Any] = {}
    code = fenced("example", "python").replace("print_boards(", "runs = (")
    exec(compile(code, str(README), "exec"), names)
    boards = leaderboards(names["runs"])
    assert [board.pace for board in boards] == [*PACES]
    for board in boards:
        first, *others = board.standings
        assert (first.policy, first.rank) == ("mine", 1)
        assert all(first.scores["path_error_m"].high < each.scores["path_error_m"].low for each in others)


def test_the_first_episode_runs(capsys: pytest.CaptureFixture[str]):
    (code,) = blocks_of(ROOT / "docs" / "first-steps.md")
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    exec(compile(code, "first-steps.md", "exec"), {})
    assert "arrived: True" in capsys.readouterr().out


def test_the_page_on_hands_runs(capsys: pytest.CaptureFixture[str]):
    """And it prints what it says."""
    page = ROOT / "docs" / "hands.md"
    (code,) = blocks_of(page)
    exec(compile(code, "hands.md", "exec"), {})
    assert f"prints `{capsys.readouterr().out.strip()}`" in page.read_text("utf-8")


def test_the_page_on_a_machine_of_ones_own_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """What it does with a preset and gains; the log of the block before is tested elsewhere."""
    _, code = blocks_of(ROOT / "docs" / "identify.md")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "preset.toml").write_text(format_preset(PRESET, "mine"), "utf-8")
    shutil.copy(TABLE, tmp_path / "mine" / "gains.toml")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "identify.md", "exec"), {})
    shown = capsys.readouterr().out
    assert re.match(r"mine \d.*, arrives in 100 %", shown)


@pytest.mark.slow
def test_the_page_on_extending_runs(capsys: pytest.CaptureFixture[str]):
    """All blocks one after another, each of at most twenty lines of code."""
    blocks = blocks_of(EXTENDING)
    assert len(blocks) > 5
    for block in blocks:
        assert len([line for line in block.splitlines() if line.strip()]) <= 20
    run_extending()
    assert "cautious" in capsys.readouterr().out


def test_the_page_on_trained_policies_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    copied = write_policy_as("mine", tmp_path / "policies")
    monkeypatch.chdir(copied.parent)
    run_policies()
    arrived, many = capsys.readouterr().out.splitlines()
    assert arrived == "arrived: True"
    assert int(many.split()[0]) > 0


def write_policy_as(name: str, folder: Path) -> Path:
    """Write a shipped policy to a folder under another name."""
    shipped = read_policy("residual")
    folder.mkdir()
    write_policy(dataclasses.replace(shipped.card, name=name), load_file(SHIPPED / "residual.safetensors"), "", folder)
    return folder


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_resolve(document: Path):
    text = re.sub(r"```.*?```", "", document.read_text("utf-8"), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    relative = [target.split("#")[0] for target in targets if not re.match(r"[a-z]+:|#", target)]
    missing = [target for target in relative if not (document.parent / target).exists()]
    assert not missing


@pytest.mark.parametrize(
    ("page", "name"),
    [
        ("README.md", "board: standard"),
        ("docs/scenarios/index.md", "suite"),
        ("docs/scenarios/index.md", "gap"),
        ("docs/reproduction.md", "standard test"),
        ("docs/agents.md", "seeds: ppo standard"),
        ("docs/agents.md", "seeds: residual all"),
        ("docs/agents.md", "against tuned"),
        ("docs/agents.md", "algorithms"),
        ("docs/agents.md", "ablations"),
        ("docs/agents.md", "speed"),
        ("docs/agents.md", "contexts"),
        ("docs/robustness.md", "fuzz"),
        ("docs/robustness.md", "determinism"),
        *((f"docs/scenarios/{scenario}.md", "scores") for scenario in SCENARIOS),
    ],
)
def test_tables_that_are_made_stand_between_their_markers(page: str, name: str):
    text = (ROOT / page).read_text("utf-8")
    (table,) = re.findall(rf"^<!-- {name} -->\n(.*?)^<!-- /{name} -->$", text, re.MULTILINE | re.DOTALL)
    rows = [line.count("|") for line in table.splitlines() if line.startswith("|")]
    assert len(rows) > 2, "a head, a rule and a row"


@pytest.mark.parametrize("owner", PARAMETER_CLASSES, ids=lambda owner: owner.__name__)
def test_parameters_are_frozen_and_say_unit_and_provenance(owner: type):
    assert owner.__dataclass_params__.frozen
    assert owner.__doc__
    for field in dataclasses.fields(owner):
        assert field.metadata.get("unit"), f"{owner.__name__}.{field.name} has no unit"
        assert field.metadata.get("provenance"), f"{owner.__name__}.{field.name} has no provenance"


def test_parameter_classes_are_found():
    assert {"Arm", "TorqueCurve", "Clutch", "Hand", "Machine"} <= {owner.__name__ for owner in PARAMETER_CLASSES}
