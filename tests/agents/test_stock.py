"""Stock algorithms: the scripts run, know nothing of the trainer, and a minute of PPO does not lock the arm."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from documents import load_script
from pter_gym._engine.batch import Batch
from pter_gym.benchmark import ResultsFolder, from_sb3
from pter_gym.benchmark.simulation import run, time_limit
from pter_gym.envs.scenario import training_draws
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN

pytestmark = pytest.mark.agents
torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO  # noqa: E402  (after the skip)
from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402

from pter_gym.envs.sb3 import make_sb3_vec_env  # noqa: E402  (needs Stable-Baselines3)

STOCK = Path(__file__).parents[2] / "agents" / "stock"
SCRIPTS = sorted(STOCK.glob("*.py"))
TINY: dict[str, dict[str, Any]] = {
    "cleanrl_ppo": {"steps": 256, "n": 2, "horizon": 64},
    "jax_ppo": {"steps": 512, "worlds": 16, "horizon": 16},
    "jax_shac": {"steps": 512, "worlds": 16, "horizon": 8},
    "sb3_ppo": {"steps": 64, "worlds": 2},
    "sb3_sac": {"steps": 240, "worlds": 2},
    "sb3_tqc": {"steps": 240, "worlds": 2},
}

NEEDS = {"jax_ppo": ("jax",), "jax_shac": ("jax",), "sb3_tqc": ("sb3_contrib",)}

NEAR_START = 0.25
"""Of the path; an arm that goes no further is stuck."""


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_trains_and_scores(script: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for needed in NEEDS.get(script.stem, ()):
        pytest.importorskip(needed)
    module = load_script(script)
    monkeypatch.setattr(module, "run_scenario", partial(module.run_scenario, paces=["brisk"], episodes=2))
    module.train(**TINY[script.stem], seed=3, out=tmp_path)
    runs = ResultsFolder(tmp_path).runs()
    name = f"{script.stem.replace('_', '-')}-3"
    assert {(run.policy, run.pace, run.seed) for run in runs} == {
        (policy, "brisk", 3) for policy in (name, "torque-feedback")
    }
    assert name in capsys.readouterr().out


def progress_after(steps: int) -> NDArray[np.float64]:
    """Return how much of each path a policy goes that stock PPO has learnt in so many steps."""
    torch.manual_seed(0)
    worlds = make_sb3_vec_env(4, randomisation=training_draws("standard"), max_episode_steps=1000)
    venv = VecNormalize(worlds)
    model = PPO("MlpPolicy", venv, seed=0, device="cpu").learn(steps)
    machines, tasks = zip(*find_scenario("standard").randomisation("medium", contexts=16, seed=5).pairs(), strict=True)
    limits = [time_limit(task) for task in tasks]
    rows = run(Batch(machines, tasks), from_sb3(model, venv), list(range(16)), limits).telemetry
    return np.nanmax(rows[..., COLUMN.reached], axis=0) / [task.path.length for task in tasks]


@pytest.mark.long
def test_a_minute_of_stock_ppo_does_not_lock_the_arm() -> None:
    reached = progress_after(60_000)
    assert reached.min() > NEAR_START
    assert reached.mean() > 0.75
