"""How long episodes take: to draw, to put into worlds, and to score policies on in new worlds.

Counted is processor time.

    python benchmarks/scoring.py
    python benchmarks/scoring.py --beside FOLDER

FOLDER is another checkout of this project, whose times stand beside these with their ratio. Both
are measured in turns, on one thread, each in a process of its own; of each time the least counts.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from time import process_time

import tyro

HERE = Path(__file__).resolve().parents[1]

SCENARIOS = ("standard", "paths", "everything")
POLICIES = ("single-dof-tuned", "ppo-standard", "residual")
WORKER = "--measure"


def measure(episodes: int, seed: int) -> dict[str, float]:
    """Return milliseconds of processor time for an episode, by what they are spent on."""
    from pter_gym.benchmark import evaluate, find_policy, training_episodes
    from pter_gym.hands import MultiSineHand
    from pter_gym.scenarios import find_scenario
    from pter_gym.scenarios.distributions import Draws, Uniform, Vary
    from pter_gym.tasks.path_following import PathFollowing

    took = dict[str, float]()

    def note(name: str, began: float) -> None:
        took[name] = 1e3 * (process_time() - began) / episodes

    hand = Vary(MultiSineHand(random_phases=True), push=Uniform(45.0, 75.0))
    own = find_scenario(Draws(task=Vary(PathFollowing(), hand=hand)))
    training_episodes(own, "medium", 8, seed)
    began = process_time()
    training_episodes(own, "medium", episodes, seed + 1)
    note("Draws of one's own: drawing", began)
    for scenario in SCENARIOS:
        policies = {name: find_policy(name, scenario) for name in POLICIES}
        few = training_episodes(scenario, "medium", 8, seed)
        for policy in policies.values():  # compiles
            evaluate(policy, few, 1, ranking=True)
        began = process_time()
        drawn = training_episodes(scenario, "medium", episodes, seed + 1)
        note(f"{scenario}: drawing", began)
        began = process_time()
        with drawn.worlds("torque"):
            pass
        note(f"{scenario}: worlds", began)
        for name, policy in policies.items():
            began = process_time()
            evaluate(policy, drawn[:], 1, ranking=True)
            note(f"{scenario}: {name}", began)
    return took


def least_of(folder: Path, times: list[dict[str, float]], episodes: int) -> None:
    """Measure a checkout once more."""
    command = (sys.executable, __file__, WORKER, str(episodes), str(len(times)))
    env = os.environ | {"PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
    result = subprocess.run(command, env=env, capture_output=True, check=True, text=True)
    times.append(json.loads(result.stdout))


def main(beside: Path | None = None, episodes: int = 512, turns: int = 3) -> None:
    """Print a table.

    Args:
        beside: Another checkout.
        episodes: Episodes of each measurement.
        turns: Measurements of each checkout.
    """
    folders = [HERE, *([beside.resolve()] if beside else [])]
    times: list[list[dict[str, float]]] = [[] for _ in folders]
    for _ in range(turns):
        for folder, taken in zip(folders, times, strict=True):
            least_of(folder, taken, episodes)
    least = [{name: min(one[name] for one in taken) for name in taken[0]} for taken in times]
    print("ms an episode" + "; beside it the other checkout and the ratio" * (len(least) > 1))
    for name, here in least[0].items():
        others = [each[name] for each in least[1:]]
        print(f"{name:30}{here:8.3f}", *(f"{there:8.3f}  {there / here:5.2f}" for there in others))


if __name__ == "__main__":
    if sys.argv[1:2] == [WORKER]:
        json.dump(measure(*map(int, sys.argv[2:])), sys.stdout)
    else:
        tyro.cli(main)
