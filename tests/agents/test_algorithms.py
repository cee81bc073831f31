"""An algorithm is one table and one module: one that only this test knows is trained, goes on, and is exported."""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest

from pter_gym.errors import ParameterError

pytestmark = pytest.mark.agents

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from pter_agents import algorithms, command, exporting, training  # noqa: E402
from pter_agents.ppo import PPOSettings  # noqa: E402
from pter_agents.settings import TrainingSettings  # noqa: E402
from pter_gym.policies import read_policy  # noqa: E402

OF_PPO = {item.name for item in fields(PPOSettings)} - {item.name for item in fields(TrainingSettings)}


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of an algorithm that was added."""
    known = asdict(algorithms.load_settings("ppo"))
    entry = 'algorithm = { action = "the clutch voltages", module = "advantage" }'
    lines = [f"{name} = {json.dumps(value)}" for name, value in known.items() if name not in OF_PPO]
    (tmp_path / "advantage.toml").write_text("\n".join([entry, *lines, "rate = 1e-3"]))
    monkeypatch.setattr(algorithms, "FOLDER", tmp_path)
    monkeypatch.setattr(algorithms, "ALGORITHMS", algorithms.listed(tmp_path))
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    yield "advantage"
    sys.modules.pop("advantage", None)


def test_an_algorithm_is_one_table_and_one_module(added: str, tmp_path: Path) -> None:
    command.train(added, smoke=True, out=tmp_path / "run")
    command.train(added, smoke=True, out=tmp_path / "run", resume=True)
    arguments, _ = training.RunFolder(tmp_path / "run").read()
    settings: Any = arguments.settings
    assert (arguments.algorithm, settings.rate, settings.worlds) == (added, 1e-3, 64)
    path, difference = exporting.export_run(tmp_path / "run", tmp_path / "out")
    assert difference <= exporting.SAME
    about = read_policy(added, path.parent).card.about
    assert (about["algorithm"], about["steps"]) == (added, 3 * 64 * 32)


def test_an_algorithm_has_its_own_hyperparameters(added: str, tmp_path: Path) -> None:
    file = tmp_path / "some.toml"
    file.write_text("clip = 0.3")
    with pytest.raises(ParameterError, match="config must be among"):
        algorithms.load_settings(added, file)
    file.write_text("rate = 0.0")
    with pytest.raises(ParameterError, match=r"AdvantageSettings\.rate must be a finite number and > 0"):
        algorithms.load_settings(added, file)


def test_the_help_names_each_algorithm() -> None:
    for name, algorithm in algorithms.ALGORITHMS.items():
        assert f"{name} ({algorithm.action})" in command.TRAINED
