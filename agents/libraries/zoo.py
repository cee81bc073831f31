"""rl-baselines3-zoo with the settings of this folder: `python agents/libraries/zoo.py`."""

import subprocess
import sys
from pathlib import Path

import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from pter_gym.benchmark import examine, from_sb3
from pter_gym.envs.sb3 import make_sb3_vec_env

SETTINGS = Path(__file__).parent / "zoo"


def train(seed: int = 0, steps: int = -1, out: Path = Path("runs/zoo")):
    command = (
        "-m rl_zoo3.train --algo ppo --env PTER/Standard-v0 --gym-packages pter_gym --device cpu"
    )
    options = f"--num-threads 1 --eval-freq -1 --verbose 0 --seed {seed} --n-timesteps {steps}"
    files = ["--log-folder", out, "--conf-file", SETTINGS / "ppo.yml"]
    subprocess.run([sys.executable, *command.split(), *options.split(), *files], check=True)
    newest = max(
        (out / "ppo").glob("PTER-Standard-v0_*"), key=lambda run: int(run.name.rpartition("_")[2])
    )
    model = PPO.load(newest / "PTER-Standard-v0.zip", device="cpu")
    return from_sb3(
        model,
        VecNormalize.load(newest / "PTER-Standard-v0" / "vecnormalize.pkl", make_sb3_vec_env(1)),
    )


if __name__ == "__main__":
    for name, verdict in examine({"zoo": tyro.cli(train)}).items():
        print(f"{name:>8}  {verdict}")
