"""Learning libraries: each script learns within a minute; torch's tensors share arrays' memory."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from documents import load_script
from pter_gym.benchmark import examine, from_sb3

pytestmark = [
    pytest.mark.agents,
    # the libraries' own: packages that they find deprecated, and what they do with their arguments
    pytest.mark.filterwarnings("ignore"),
]
torch = pytest.importorskip("torch")
make_sb3_vec_env = pytest.importorskip("pter_gym.envs.sb3", exc_type=ImportError).make_sb3_vec_env

ID = "PTER/Standard-v0"
FOLDER = Path(__file__).parents[2] / "agents" / "libraries"
NEEDS = {
    "rsl_rl_ppo": "rsl_rl",
    "skrl_ppo": "skrl",
    "torchrl_ppo": "torchrl",
    "zoo": "huggingface_sb3",  # comes with the zoo, whose import changes Gymnasium's TimeLimit
}
TINY: dict[str, dict[str, Any]] = {
    name: {"steps": 512, "worlds": 8, "horizon": 32} for name in NEEDS
}
TINY |= {"zoo": {"steps": 64}}
LEARNERS: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (f"{name}_ppo", {}) for name in ("rsl_rl", "skrl", "torchrl")}
}
SEEDS = 3


def train(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **options: Any) -> Any:
    pytest.importorskip(NEEDS[script])
    if script == "zoo":
        options["out"] = tmp_path
    monkeypatch.chdir(tmp_path)
    return load_script(FOLDER / f"{script}.py").train(**options)


@pytest.mark.slow
@pytest.mark.parametrize("script", NEEDS)
def test_a_script_trains(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = train(script, tmp_path, monkeypatch, **TINY[script], seed=3)
    assert examine({script: policy}, episodes=2).keys() == {script, "free", "locked", "random"}


@pytest.mark.slow
def test_the_study_shows_each_seed_and_trains_none_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = load_script(FOLDER.parent / "stock" / "study.py").study
    out, picture = tmp_path / "curves.csv", tmp_path / "curves.png"
    study(("A2C",), (1,), steps=2048, assessments=2, out=out)
    first = out.read_text("utf-8")
    assert len(first.splitlines()) == 1 + 3 + 1  # before, after half and all of it, and the test
    study(("A2C",), (1, 2), steps=2048, assessments=2, out=out, picture=picture)
    assert out.read_text("utf-8").startswith(first)
    assert "| A2C | 0 of 2 |" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
def test_sbx_trains_in_place_of_stable_baselines3() -> None:
    sbx = pytest.importorskip("sbx")
    worlds = make_sb3_vec_env(8, scenario="standard")
    model = sbx.PPO("MlpPolicy", worlds, n_steps=16, batch_size=64, seed=0).learn(256)
    assert examine({"sbx": from_sb3(model)}, episodes=2).keys() == {
        "sbx",
        "free",
        "locked",
        "random",
    }


@pytest.mark.long
@pytest.mark.parametrize("name", LEARNERS)
def test_most_seeds_learn_within_a_minute(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, options = LEARNERS[name]
    trained = {
        f"{name} {seed}": train(script, tmp_path, monkeypatch, **options, seed=seed)
        for seed in range(SEEDS)
    }
    verdicts = examine(trained)
    known = min(verdicts[other].path_error_m for other in ("free", "random"))
    assert np.median([verdicts[each].path_error_m for each in trained]) < 0.5 * known, verdicts
    assert np.median([verdicts[each].completed for each in trained]) > 0.9, verdicts
