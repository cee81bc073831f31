"""What algorithms of Stable-Baselines3 and sb3-contrib learn in equal CPU time: `python
agents/stock/study.py`.

For each algorithm, three settings are tried with a seed of their own, and the one with the smallest
path errors on held-out training episodes is trained with further seeds. Ends with leaderboards on
test episodes, with a row for all seeds and one for each."""

from dataclasses import replace
from pathlib import Path
from statistics import geometric_mean
from time import process_time
from typing import Any

import sb3_contrib as contrib
import stable_baselines3 as sb3
import torch
import tyro
from stable_baselines3.common.callbacks import BaseCallback

from pter_gym.benchmark import (
    ResultsFolder,
    evaluate,
    from_sb3,
    print_boards,
    run_scenario,
    training_episodes,
)
from pter_gym.envs.sb3 import make_sb3_vec_env
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import RewardWeights

ON_POLICY = {"n_steps": 64, "gae_lambda": 0.98}
ENTROPY = ({}, {"ent_coef": 0.05}, {"ent_coef": 0.005})
CANDIDATES: dict[str, tuple[Any, int, tuple[dict[str, Any], ...]]] = {
    "PPO": (sb3.PPO, 64, ({"n_steps": 64}, ON_POLICY, {**ON_POLICY, "batch_size": 1024})),
    "A2C": (
        sb3.A2C,
        64,
        ({}, {"gae_lambda": 0.98}, {**ON_POLICY, "n_steps": 16, "normalize_advantage": True}),
    ),
    "TRPO": (contrib.TRPO, 64, ({"n_steps": 64}, ON_POLICY, {**ON_POLICY, "target_kl": 0.03})),
    "SAC": (sb3.SAC, 8, ENTROPY),
    "TQC": (contrib.TQC, 8, ENTROPY),
    "CrossQ": (contrib.CrossQ, 8, ENTROPY),
}
"""Class, number of worlds, and settings that differ from the library's defaults."""

TUNING_SEED = 0

VALIDATION_SEED = 2**31 + 1
"""Seed of held-out training episodes."""


class CpuTime(BaseCallback):
    """Ends a training when this process has used more seconds."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.end = process_time() + seconds

    def _on_step(self) -> bool:
        return process_time() < self.end


def train(
    algorithm: str, settings: dict[str, Any], seed: int, seconds: float, effort: float
) -> Any:
    made, worlds, _ = CANDIDATES[algorithm]
    reward = RewardWeights(effort=effort)
    venv = make_sb3_vec_env(worlds, scenario="standard", truncation_error=0.1, reward=reward)
    return made("MlpPolicy", venv, seed=seed, device="cpu", **settings).learn(
        10**9, CpuTime(seconds)
    )


def study(
    algorithms: tuple[str, ...] = tuple(CANDIDATES),
    seeds: int = 10,
    seconds: float = 100.0,
    fresh: int = 0,
    out: Path = Path("study"),
    effort: float = RewardWeights.effort,
) -> None:
    torch.set_num_threads(1)
    held_out = [training_episodes("standard", pace, 64, VALIDATION_SEED) for pace in PACES]

    def merit(model: Any) -> float:
        policy = from_sb3(model)
        return geometric_mean(evaluate(policy, each)["path_error_m"].mean() for each in held_out)

    for algorithm in algorithms:
        trials = [
            (merit(train(algorithm, each, TUNING_SEED, seconds, effort)), each)
            for each in CANDIDATES[algorithm][2]
        ]
        for error, settings in trials:
            print(
                f"{algorithm} with {settings}: {1e3 * error:.1f} mm on training episodes",
                flush=True,
            )
        best = min(trials, key=lambda each: each[0])[1]
        models = [train(algorithm, best, seed, seconds, effort) for seed in range(1, 1 + seeds)]
        print(f"{algorithm}: {[model.num_timesteps for model in models]} steps", flush=True)
        policies = {algorithm: [from_sb3(model) for model in models]}
        runs = run_scenario(
            "standard", policies, seed=fresh, results=ResultsFolder(out / algorithm)
        )
        alone = [
            replace(run, policy=f"{algorithm} {1 + run.training_seed}", training_seed=0)
            for run in runs
        ]
        print_boards([*runs, *alone])


if __name__ == "__main__":
    tyro.cli(study)
