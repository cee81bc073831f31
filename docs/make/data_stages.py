"""Train the policy whose stages act in the data sets, and export them to ``pter_gym/datasets/stages``.

    python docs/make/data_stages.py RUNS

takes about five minutes of a core; RUNS/everything is the folder of the run, which must not exist.
"""

import shutil
import sys
from pathlib import Path

from pter_agents.algorithms import load_settings
from pter_agents.checkpoints import checkpoints
from pter_agents.exporting import export_run
from pter_agents.ppo import PPOSettings
from pter_agents.training import PROGRESS, RUN, Arguments, train
from pter_gym.datasets.levels import STAGES, STAGES_TABLE
from pter_gym.internal.files import write_text_atomic

STEPS = 6_000_000
EVERY = 983_040
"""Control steps between two stages: three checkpoints."""

MEDIUM = {"standard": "stage-3", "others": "stage-6"}
"""What is medium: clearly better than random and worse than the expert, on training draws."""


def main(runs: Path) -> None:
    """Train, and write a policy for each stage."""
    run, kept = runs / "everything", runs / "kept"
    kept.mkdir(parents=True, exist_ok=True)
    settings = load_settings("ppo")
    assert isinstance(settings, PPOSettings)
    arguments = Arguments(algorithm="ppo", scenario="everything", pace="all", steps=STEPS, seed=0, settings=settings)

    def keep(_: int = 0) -> None:
        for path in checkpoints(run):
            if not (kept / path.name).exists():
                shutil.copy(path, kept)

    train(arguments, run, on_progress=keep)
    keep()
    reached = {steps_of(path): path for path in checkpoints(kept)}
    wanted = [steps for steps in reached if steps % EVERY == 0 and steps + EVERY // 2 < STEPS] + [max(reached)]
    table = [
        f"# Made by `python docs/make/data_stages.py RUNS`; σ is `deviation`, ρ is `persistence`.\n\nsteps = {STEPS}",
        'command = "pter train ppo --scenario everything --steps 6000000 --seed 0"',
        f"persistence = {settings.persistence}\n\n[medium]",
        *(f'{scenario} = "{name}"' for scenario, name in MEDIUM.items()),
    ]
    for number, steps in enumerate(wanted):
        name = f"stage-{number}"
        export_stage(run, reached[steps], runs / name, name)
        deviation = settings.deviation_at(min(steps / STEPS, 1.0))
        table.append(f'\n[[stages]]\nname = "{name}"\nsteps = {steps}\ndeviation = {deviation:.6g}')
    write_text_atomic(STAGES / STAGES_TABLE, "\n".join(table) + "\n")


def steps_of(path: Path) -> int:
    return int(path.stem.split("-")[1])


def export_stage(run: Path, checkpoint: Path, folder: Path, name: str) -> None:
    """Write a policy of a run as it was at a checkpoint."""
    folder.mkdir(exist_ok=True)
    for path in (run / RUN, run / PROGRESS, checkpoint):
        shutil.copy(path, folder)
    export_run(folder, STAGES, name=name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
