"""A trained policy is trained again from its card: the same weights on the same machine, both on fresh episodes."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from pter_gym.errors import DataError, ParameterError

pytestmark = pytest.mark.agents

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from pter_agents import retraining, training  # noqa: E402
from pter_agents.algorithms import load_settings, settings_from  # noqa: E402
from pter_agents.exporting import export_run  # noqa: E402

SMALL = {"worlds": 16, "steps": 8, "minibatch": 64, "epochs": 2, "contexts": 4, "hidden": [8], "value_hidden": [8]}


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """The path of the card of a policy that was trained for a moment."""
    settings = settings_from("ppo", {**asdict(load_settings("ppo")), **SMALL})
    given = training.Arguments(
        algorithm="ppo", scenario="hands", pace="all", steps=500, seed=5, settings=settings, validation_episodes=2
    )
    training.train(given, tmp_path / "run")
    return export_run(tmp_path / "run", tmp_path / "policy", name="tiny")[0]


def test_a_policy_comes_out_again(card: Path, tmp_path: Path) -> None:
    shipped = retraining.find_trained(str(card))
    done: list[tuple[int, int]] = []
    again = retraining.retrain(shipped, tmp_path / "again", on_progress=lambda *each: done.append(each))
    assert again.card.name == "tiny-again"
    assert done[-1] == (512, 500)
    assert again.card.weights_sha256 == shipped.card.weights_sha256
    boards = retraining.compare(shipped, again, episodes=2)
    assert [board.pace for board in boards] == ["slow", "medium", "brisk"]
    for board in boards:
        assert (board.scenario, board.fresh is None) == ("hands", False)
        found: Any = board.as_json()["policies"]
        assert found["tiny"]["path_error_m"]["value"] == found["tiny-again"]["path_error_m"]["value"]
    later = retraining.retrain(shipped, tmp_path / "again")
    assert later.card.weights_sha256 == shipped.card.weights_sha256, "a finished run is not trained again"


def test_what_was_not_trained_is_refused(card: Path) -> None:
    with pytest.raises(ParameterError, match="policy must be one that was trained, got 'impedance'"):
        retraining.find_trained("impedance")
    shipped = retraining.find_trained(str(card))
    for about in ({}, {**shipped.card.about, "settings": {"worlds": 3}}, {**shipped.card.about, "algorithm": "gone"}):
        other = replace(shipped, card=replace(shipped.card, about=json.loads(json.dumps(about))))
        with pytest.raises(DataError, match="does not tell a training"):
            retraining.retrain(other, card.parent / "never")
    assert not (card.parent / "never").exists()
