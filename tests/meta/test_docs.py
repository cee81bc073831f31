"""What the documents promise exists: imports, commands, links, examples, results, units."""

import ast
import dataclasses
import inspect
import re
import shlex
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import fill
import pytest
from interface import modules  # in docs/make

from documents import DOCS, NOTEBOOKS, README, ROOT, blocks_of, cells_of, readme, run_program
from pter_gym import params
from pter_gym._commands.main import main
from pter_gym.params import BASELINE, save_machine
from pter_gym.policies.tuned import read_gains
from pter_gym.tools.identification import read_log
from pter_gym.tools.tuning.gains_file import format_table

DOCUMENTS = sorted([*ROOT.glob("*.md"), *DOCS.glob("**/*.md")])
PARAMETER_CLASSES = [
    item
    for _, item in inspect.getmembers(params, dataclasses.is_dataclass)
    if inspect.isclass(item) and item is not params.MachineSpread
]
PUSH = "time,along,across\n0,40,0\n0.1,40,2\n0.2,40,0\n"
"""A push as the page in the browser writes it."""

OWN_TESTS = {DOCS / name for name in ("data.md", "identify.md", "watching.md")}
"""Pages whose code needs what commands have written; tests below and beside the tools run it."""

RUNNING = [page for page in DOCS.glob("**/*.md") if blocks_of(page) and page not in OWN_TESTS]

IDENTIFY = DOCS / "identify.md"
WATCHING = DOCS / "watching.md"
WATCH = [
    shlex.split(line)[1:]
    for line in re.findall(r"^    (pter .*)$", WATCHING.read_text("utf-8"), re.MULTILINE)
]


def documented_imports() -> list[str]:
    """Return the statements that import names of the packages, in all that users read."""
    code = [block for page in DOCUMENTS if page.name != "CHANGELOG.md" for block in blocks_of(page)]
    code += [cell for notebook in NOTEBOOKS for cell in cells_of(notebook)]
    code += [file.read_text("utf-8") for file in (ROOT / "examples").glob("*.py")]
    nodes = [node for block in code for node in ast.walk(ast.parse(block))]
    found = {ast.unparse(node) for node in nodes if isinstance(node, ast.ImportFrom | ast.Import)}
    return sorted(
        each for each in found if re.match(r"(from|import) (pter_gym|pter_agents)\b", each)
    )


@pytest.mark.parametrize("statement", documented_imports())
def test_documented_imports_work(statement: str):
    try:
        exec(statement, {})
    except ImportError as error:
        if (error.name or "").startswith("pter_"):
            raise
        pytest.skip(str(error))


@pytest.mark.agents
def test_users_read_of_nothing_that_the_reference_leaves_out() -> None:
    listed = modules(behind=True)
    for statement in documented_imports():
        (node,) = ast.parse(statement).body
        module = getattr(node, "module", "") or ""
        if isinstance(node, ast.ImportFrom) and module.split(".")[0] == "pter_gym":
            for name in (each.name for each in node.names):
                public = getattr(import_module(module), "__all__", [name])
                own = module in listed and name in public and not name.startswith("_")
                assert own or f"{module}.{name}" in listed, statement


def test_readme_trains_with_the_example():
    _, _, code = (ROOT / "examples" / "sb3_plain.py").read_text("utf-8").partition("\n\n")
    assert readme("example") == code


@pytest.mark.long
@pytest.mark.agents
@pytest.mark.filterwarnings("ignore:rich is experimental")
@pytest.mark.parametrize(
    ("name", "shorter"),
    [
        ("sb3_plain", {"1_250_000": "8_192"}),
        ("sb3_base", {"5_000_000": "8_192"}),
        ("sb3_asymmetric", {"600_000": "8_192"}),
        ("sb3_ppo", {"1_250_000, 2_750_000": "4_096, 8_192"}),
    ],
)
def test_an_example_trains(
    name: str, shorter: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    """As it is, but with fewer steps; the first is README's."""
    pytest.importorskip("stable_baselines3")
    program = (ROOT / "examples" / f"{name}.py").read_text("utf-8")
    for old, new in shorter.items():
        assert old in program
        program = program.replace(old, new)
    run_program([program], name)
    assert "tuned law" in capsys.readouterr().out


@pytest.mark.long
def test_the_results_in_the_readme_are_those_of_its_command(tmp_path: Path) -> None:
    _, *given = shlex.split(readme("command: results"))
    assert main([*given, "--out", str(tmp_path)]) == 0
    (block,) = (
        block for block in fill.blocks() if block.page == README and block.source == "board"
    )
    assert block.make(tmp_path) == block.content


@pytest.mark.smoke
def test_readme_steps_the_environment(capsys: pytest.CaptureFixture[str]):
    run_program([readme("step")], str(README))
    assert f"prints `{capsys.readouterr().out.strip()}`" in README.read_text("utf-8")


MARKS = dict.fromkeys(("gradients", "your-algorithm"), pytest.mark.long)


@pytest.mark.parametrize(
    "page", [pytest.param(page, id=page.stem, marks=MARKS.get(page.stem, ())) for page in RUNNING]
)
def test_code_on_a_page_prints_what_the_page_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    if page.name == "your-algorithm.md":
        pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(tmp_path)
    Path("push.csv").write_text(PUSH, "utf-8")
    run_program(blocks_of(page), str(page))
    shown = page.read_text("utf-8")
    assert not [
        line
        for line in capsys.readouterr().out.splitlines()
        if " ".join(line.split()) not in " ".join(shown.split())
    ]


def test_the_law_on_the_page_on_extending_arrives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    page = DOCS / "extending.md"
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(blocks_of(page)[0], "utf-8")
    assert main(["watch", "mine.py:law,impedance", "--csv", "two.csv"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert "arrived" in first
    assert first in page.read_text("utf-8")


def test_the_recorder_on_the_page_on_identification_writes_a_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    now = [1e9]
    monkeypatch.setattr(time, "monotonic", lambda: now[-1])
    monkeypatch.setattr(time, "sleep", lambda duration: now.append(now[-1] + duration))
    block = blocks_of(IDENTIFY)[0]
    known: dict[str, Any] = run_program([block], "identify.md")
    text = IDENTIFY.read_text("utf-8")
    ((call, seconds),) = re.findall(r"^`(record\(.*\))` takes (\d+) s", text, re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    exec(call, known)
    log = read_log("log.csv")
    assert log.duration == pytest.approx(float(seconds), abs=0.5)
    assert log.volts.max() == 24.0
    assert log.volts.min() == 0.0


def test_the_page_on_a_machine_of_ones_own_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """What it does with a machine and gains; the log of the block before is tested elsewhere."""
    (tmp_path / "mine").mkdir()
    save_machine(BASELINE, tmp_path / "mine" / "machine.toml", origin="chosen: for tests")
    gains = {"standard": {"single-dof": read_gains()["standard"]["single-dof"]}}
    (tmp_path / "mine" / "gains.toml").write_text(format_table(gains), "utf-8")
    monkeypatch.chdir(tmp_path)
    run_program(blocks_of(IDENTIFY)[1:], "identify.md")
    assert re.match(r"mine \d.*, arrives in 100 %", capsys.readouterr().out)


@pytest.mark.parametrize("given", [each for each in WATCH if "--csv" in each], ids=" ".join)
def test_the_tables_of_the_page_on_watching_are_read(
    given: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    assert main(given) == 0
    arrived = [line for line in capsys.readouterr().out.splitlines() if "arrived" in line]
    assert all(line in WATCHING.read_text("utf-8") for line in arrived)
    (block,) = (block for block in blocks_of(WATCHING) if given[-1] in block)
    if "pandas" in block:
        pytest.importorskip("pandas")
    run_program([block], "watching.md")
    assert re.search(r"\d", capsys.readouterr().out)


@pytest.mark.long
def test_the_page_on_watching_records_videos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("moviepy")
    pytest.importorskip("pygame")
    monkeypatch.chdir(tmp_path)
    run_program([block for block in blocks_of(WATCHING) if "RecordVideo" in block], "watching.md")
    assert [len(list(Path(folder).glob("*.mp4"))) for folder in ("videos", "grids")] == [1, 1]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_resolve(document: Path):
    text = re.sub(r"```.*?```", "", document.read_text("utf-8"), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    relative = [target.split("#")[0] for target in targets if not re.match(r"[a-z]+:|#", target)]
    assert not [target for target in relative if not (document.parent / target).exists()]


@pytest.mark.parametrize("owner", PARAMETER_CLASSES, ids=lambda owner: owner.__name__)
def test_parameters_are_frozen_and_say_unit_and_provenance(owner: type):
    assert owner.__dataclass_params__.frozen
    for field in dataclasses.fields(owner):
        assert field.metadata.get("unit"), f"{owner.__name__}.{field.name} has no unit"
        assert field.metadata.get("provenance"), f"{owner.__name__}.{field.name} has no provenance"
