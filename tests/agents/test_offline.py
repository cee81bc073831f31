"""Offline learning: the scripts read what `pter record` wrote, train and score."""

import sys
from pathlib import Path

import pytest

from documents import load_script
from pter_gym._commands.main import main
from pter_gym.benchmark import ResultsFolder
from pter_gym.scenarios import PACES

pytestmark = pytest.mark.agents
torch = pytest.importorskip("torch")
for package in ("minari", "torchrl"):
    pytest.importorskip(package)

OFFLINE = Path(__file__).parents[2] / "agents" / "stock" / "offline"
SCRIPTS = sorted(path for path in OFFLINE.glob("*.py") if path.stem != "common")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # torchrl's own
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_trains_and_scores(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (
        main(
            [
                "record",
                "--scenario",
                "standard",
                "--level",
                "random",
                "--steps",
                "300",
                "--out",
                str(tmp_path),
            ]
        )
        == 0
    )
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    monkeypatch.setattr(sys, "path", [str(OFFLINE), *sys.path])
    load_script(script).train(
        "pter/standard/random-v0", seed=3, steps=4, batch=8, out=tmp_path / "results"
    )
    name = f"{script.stem.replace('_', '-')}-random-3"
    found = {(run.policy, run.pace) for run in ResultsFolder(tmp_path / "results").runs()}
    assert found == {(name, pace) for pace in PACES}
