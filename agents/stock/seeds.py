"""How often the PPO of the examples arrives: `python agents/stock/seeds.py --seeds 0 64 128`.

Trains Stable-Baselines3's PPO with many seeds, as `examples/sb3_plain.py` does, with its default
settings in four worlds (`--settings defaults`), or as `examples/sb3_base.py` does (`--settings
base`), and prints each one's scores on test episodes."""

from statistics import median
from time import process_time
from typing import Any, Literal

import torch
import tyro
from stable_baselines3 import PPO

from pter_gym.benchmark import from_sb3, leaderboards, run_scenario
from pter_gym.envs.sb3 import make_sb3_vec_env
from pter_gym.tasks.path_following import RewardWeights

CAUGHT = 25.0
"""Path error at the medium pace above which a training counts as caught [mm]."""


Setting = tuple[Any, int, dict[str, Any]]
"""Worlds, steps, and settings that differ from the library's."""

ON_POLICY = {"n_steps": 64, "gae_lambda": 0.98}


def plain(effort: float) -> Setting:
    """Return those of `examples/sb3_plain.py`."""
    venv = make_sb3_vec_env(64, scenario="standard", reward=RewardWeights(effort=effort))
    return venv, 1_250_000, {**ON_POLICY, "batch_size": 1024}


def defaults(effort: float) -> Setting:
    """Return four worlds and the library's settings."""
    venv = make_sb3_vec_env(4, scenario="standard", reward=RewardWeights(effort=effort))
    return venv, 1_500_000, {}


def corrections() -> Setting:
    """Return those of `examples/sb3_base.py`."""
    reward = RewardWeights(tracking=10, precision=90, effort=0)
    task = {"reward": reward, "starts": "rest", "error_max": 0.05}
    venv = make_sb3_vec_env(128, scenario="standard", base="single-dof-tuned", **task)
    noise = {"use_sde": True, "sde_sample_freq": 8, "policy_kwargs": {"log_std_init": -2.9}}
    return venv, 5_000_000, {**ON_POLICY, "batch_size": 2048, "gamma": 0.995, **noise}


def seeds(
    seeds: tuple[int, ...],
    settings: Literal["plain", "defaults", "base"] = "plain",
    effort: float = RewardWeights.effort,
    steps: int | None = None,
    fresh: int = 0,
) -> None:
    torch.set_num_threads(1)
    errors: list[list[float]] = []
    ranked = 0
    for seed in seeds:
        began = process_time()
        venv, usual, own = {
            "plain": lambda: plain(effort),
            "defaults": lambda: defaults(effort),
            "base": corrections,
        }[settings]()
        model = PPO("MlpPolicy", venv, seed=seed, **own)
        model.learn(steps or usual)
        spent = process_time() - began
        runs = run_scenario("standard", {"PPO": from_sb3(model)}, seed=fresh)
        errors.append([1e3 * float(run.scores["path_error_m"].mean()) for run in runs])
        has_rank = all(board.standings[0].rank is not None for board in leaderboards(runs))
        ranked += has_rank
        row = " / ".join(f"{error:.1f}" for error in errors[-1])
        print(f"{seed}: {row} mm, {spent:.0f} s{'' if has_rank else ', not ranked'}", flush=True)
    middle = " / ".join(f"{median(column):.1f}" for column in zip(*errors, strict=True))
    caught = sum(medium > CAUGHT for _, medium, _ in errors)
    print(f"median {middle} mm; {caught} of {len(seeds)} caught, {ranked} ranked at every pace")


if __name__ == "__main__":
    tyro.cli(seeds)
