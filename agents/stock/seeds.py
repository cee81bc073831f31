"""How often the PPO of the examples arrives: `python agents/stock/seeds.py --seeds 0 64 128`.

Trains Stable-Baselines3's PPO as `examples/sb3_plain.py` does (`examples/sb3_base.py` with
`--base single-dof-tuned`) with many seeds, and prints the scores of each on test episodes."""

from dataclasses import asdict
from statistics import median
from time import process_time

import torch
import tyro
from stable_baselines3 import PPO

from pter_gym.benchmark import from_sb3, leaderboards, run_scenario
from pter_gym.envs.sb3 import make_sb3_vec_env
from pter_gym.tasks.path_following import RewardWeights

PLAIN = RewardWeights()
PRECISE = RewardWeights(tracking=10, precision=90, effort=0)

CAUGHT = 25.0
"""Path error at the medium pace above which a training counts as caught [mm]."""


def train(seed: int, steps: int, worlds: int, base: str | None, reward: RewardWeights) -> PPO:
    """Return the model of one training."""
    settings = {"n_steps": 64, "batch_size": 16 * worlds, "gae_lambda": 0.98}
    if base is not None:
        noise = {"use_sde": True, "sde_sample_freq": 8, "policy_kwargs": {"log_std_init": -2.3}}
        settings |= noise
    venv = make_sb3_vec_env(worlds, scenario="standard", base=base, reward=reward)
    return PPO("MlpPolicy", venv, seed=seed, device="cpu", **settings).learn(steps)


def seeds(
    seeds: tuple[int, ...],
    steps: int | None = None,
    base: str | None = None,
    reward: RewardWeights | None = None,
    fresh: int = 0,
) -> None:
    torch.set_num_threads(1)
    worlds, given, weights = (64, 1_250_000, PLAIN) if base is None else (128, 3_000_000, PRECISE)
    weights = weights if reward is None else reward
    print(asdict(weights))
    errors: list[list[float]] = []
    ranked = 0
    for seed in seeds:
        began = process_time()
        model = train(seed, given if steps is None else steps, worlds, base, weights)
        spent = process_time() - began
        runs = run_scenario("standard", {"PPO": from_sb3(model)}, seed=fresh)
        errors.append([1e3 * float(run.scores["path_error_m"].mean()) for run in runs])
        good = all(board.standings[0].rank is not None for board in leaderboards(runs))
        ranked += good
        row = " / ".join(f"{error:.1f}" for error in errors[-1])
        print(f"{seed}: {row} mm, {spent:.0f} s{'' if good else ', not ranked'}", flush=True)
    middle = " / ".join(f"{median(column):.1f}" for column in zip(*errors, strict=True))
    caught = sum(each[1] > CAUGHT for each in errors)
    print(f"median {middle} mm; {caught} of {len(seeds)} caught, {ranked} ranked at every pace")


if __name__ == "__main__":
    tyro.cli(seeds)
