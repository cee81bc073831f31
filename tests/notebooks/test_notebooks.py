"""The notebooks run from top to bottom, and git holds them with what they show."""

import ast
import re
import tomllib

import nbformat
import pytest
from nbclient import NotebookClient

from documents import NOTEBOOKS, ROOT, cells_of


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_stored(path):
    """`jupyter nbconvert --execute --inplace` stores them."""
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    for cell in notebook.cells:
        assert not cell.metadata
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [
        output
        for output in outputs
        if output.output_type == "error" or output.get("name") == "stderr"
    ]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_names_are_public(path):
    nodes = [node for source in cells_of(path) for node in ast.walk(ast.parse(source))]
    modules = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    names = [
        alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom | ast.Import)
        for alias in node.names
    ]
    assert not [name for name in (*modules, *names) if re.search(r"(^|\.)_", name)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_first_cell_installs_from_the_projects_address(path):
    address = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"][
        "Source"
    ]
    first = next(
        cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"
    )
    assert f'SOURCE = "{address}"' in first
    assert re.search(r"except ImportError:\n    %pip install .*{SOURCE}", first)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*TCP without encryption.*")
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(n, id=n.stem, marks=[] if "clutch" in n.stem else pytest.mark.long)
        for n in NOTEBOOKS
    ],
)
def test_the_notebook_runs_and_shows_pictures(path, tmp_path, monkeypatch):
    if "agent" in path.stem:
        pytest.importorskip("stable_baselines3")
    if "machine" in path.stem:
        pytest.importorskip("optuna")
    monkeypatch.setenv("PTER_TRAINING_STEPS", "81920")  # trials of two rollouts
    monkeypatch.setenv("PTER_NOTEBOOK_EPISODES", "24")
    monkeypatch.setenv("PTER_NOTEBOOK_TRIALS", "30")
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    told = "".join(output["text"] for output in outputs if output.get("name") == "stderr")
    assert not told.replace("pter_gym: compiling, once: about 20 s\n", "")
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("lengths", "reason"),
    [
        ((0.3, 0.3), r"line: .* within reach.* \(-0\.45, 0\.65\) m is not"),
        ((0.8, 0.3), "circle: .* within reach"),
    ],
)
def test_a_machine_that_cannot_do_the_paths_is_refused_before_it_is_simulated(lengths, reason):
    optuna = pytest.importorskip("optuna")
    (path,) = [path for path in NOTEBOOKS if "machine" in path.stem]
    sources = cells_of(path)
    known = {}
    for source in sources[: 1 + next(k for k, each in enumerate(sources) if "def judge" in each)]:
        exec(source.partition("study = ")[0], known)
    known["roll_out"] = None  # nothing is simulated
    point = {**known["PTER_POINT"], "length_a": lengths[0], "length_b": lengths[1]}
    trial = optuna.trial.FixedTrial(point)
    with pytest.raises(optuna.TrialPruned):
        known["judge"](trial)
    assert re.match(reason, trial.user_attrs["refused"])
    assert known["reason_against"](known["machine_of"](known["PTER_POINT"])) is None
