"""Ray Tune searches two settings of RLlib's PPO: `python agents/at_scale/ray_tune.py`, and shows the returns."""

from pathlib import Path

import tyro
from ray import tune
from rllib_ppo import make_config

RETURN = "env_runners/episode_return_mean"
"""What decides: the returns of training episodes, never an evaluation episode."""


def search(trials: int = 4, steps: int = 40_000, seed: int = 0, out: Path = Path("tuned")) -> tune.ResultGrid:
    config = make_config(seed).training(lr=tune.loguniform(1e-4, 3e-3), gamma=tune.uniform(0.97, 0.995))
    draws = tune.search.BasicVariantGenerator(random_state=seed)
    plan = tune.TuneConfig(metric=RETURN, mode="max", num_samples=trials, search_alg=draws)
    run = tune.RunConfig(stop={"env_runners/num_env_steps_sampled_lifetime": steps}, storage_path=out.resolve())
    return tune.Tuner("PPO", param_space=config, tune_config=plan, run_config=run).fit()


def main(trials: int = 4, steps: int = 40_000, seed: int = 0, out: Path = Path("tuned")) -> None:
    found = search(trials, steps, seed, out)
    print(found.get_dataframe()[["config/lr", "config/gamma", RETURN]].sort_values(RETURN).to_string(index=False))


if __name__ == "__main__":
    tyro.cli(main)
