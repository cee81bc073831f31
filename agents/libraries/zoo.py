"""rl-baselines3-zoo with the settings in `agents/libraries/zoo`: `python agents/libraries/zoo.py --algorithm tqc`."""

import subprocess
import sys
from pathlib import Path
from typing import Literal

import tyro
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import VecNormalize

from pter_gym.benchmark import examine, from_sb3
from pter_gym.envs.sb3 import make_sb3_vec_env

ALGORITHMS = {"ppo": PPO, "sac": SAC, "tqc": TQC}
SETTINGS = Path(__file__).parent / "zoo"


def train(
    algorithm: Literal["ppo", "sac", "tqc"] = "ppo", seed: int = 0, steps: int = -1, out: Path = Path("runs/zoo")
):
    command = f"-m rl_zoo3.train --algo {algorithm} --env PTER/Standard-v0 --gym-packages pter_gym --device cpu"
    options = f"--num-threads 1 --eval-freq -1 --verbose 0 --seed {seed} --n-timesteps {steps}"
    files = ["--log-folder", out, "--conf-file", SETTINGS / f"{algorithm}.yml"]
    subprocess.run([sys.executable, *command.split(), *options.split(), *files], check=True)
    newest = max((out / algorithm).glob("PTER-Standard-v0_*"), key=lambda run: int(run.name.rpartition("_")[2]))
    model = ALGORITHMS[algorithm].load(newest / "PTER-Standard-v0.zip", device="cpu")
    return from_sb3(model, VecNormalize.load(newest / "PTER-Standard-v0" / "vecnormalize.pkl", make_sb3_vec_env(1)))


if __name__ == "__main__":
    for name, verdict in examine({"zoo": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
