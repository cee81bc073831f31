"""The notebooks run from top to bottom, and git holds them without what they printed."""

import nbformat
import pytest
from nbclient import NotebookClient

from documents import NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_stripped(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    for cell in notebook.cells:
        assert not cell.metadata
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*TCP without encryption.*")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs_and_shows_pictures(path, tmp_path, monkeypatch):
    if "agent" in path.stem:
        pytest.importorskip("stable_baselines3")
    monkeypatch.setenv("PTER_TRAINING_STEPS", "32768")  # two rollouts
    monkeypatch.setenv("PTER_NOTEBOOK_EPISODES", "8")
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    told = "".join(output["text"] for output in outputs if output.get("name") == "stderr")
    assert not told.replace("pter_gym: compiling, once: about 20 s\n", "")
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    assert not list(tmp_path.iterdir())
