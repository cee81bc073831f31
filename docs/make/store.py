"""Data of the package that scripts make: `python docs/make/store.py episodes|paces|gains|stages`."""

import shutil
from pathlib import Path
from typing import Any

import tyro

from pter_gym._internal.files import write_text_atomic
from pter_gym.benchmark import _pacing as pacing
from pter_gym.benchmark import episodes as stored
from pter_gym.benchmark import tuned
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.scenarios._evaluation_draws import evaluation_draws

PACES_HEAD = """\
# Dampers along the path [N·s/m] with which the paper's controllers keep the commanded paces on the training
# draws of each scenario; their other gains are those of pter.toml. derived: made by `python docs/make/store.py paces`.
"""

STEPS = 6_000_000
EVERY = 983_040
"""Control steps between two stages: three checkpoints."""

MEDIUM = {"standard": "stage-3", "others": "stage-6"}
"""What is medium: clearly better than random and worse than the expert, on training draws."""


def episodes(names: tyro.conf.Positional[tuple[str, ...]] = tuple(SCENARIOS), folder: Path = stored.FOLDER) -> None:
    """Store the evaluation episodes of scenarios, of all by default, in pter_gym/episodes.

    They change every published score: raise the version of a scenario whose episodes change.
    """
    for name in names:
        scenario = find_scenario(name)
        machines, tasks, strata = zip(*evaluation_draws(scenario), strict=True)
        seeds = list(range(scenario.episodes))
        path = stored.store_episodes(name, machines, tasks, seeds, strata, version=scenario.version, folder=folder)
        print(path.name, path.stat().st_size, {kind: strata.count(kind) for kind in sorted(set(strata))})


def paces() -> None:
    """Solve the dampers in pter_gym/presets/paces.toml again, after a change of the physics."""
    text = PACES_HEAD
    for scenario, controllers in pacing.solve_table().items():
        for name, dampers in controllers.items():
            text += f"\n[{scenario}.{name}]\n"
            text += "".join(f"{pace} = {damping!r}\n" for pace, damping in dampers.items())
    write_text_atomic(pacing.TABLE, text)


def gains() -> None:
    """Score the gains in pter_gym/presets/tuned.toml again, after the score or the simulator has changed."""
    from pter_gym.benchmark._examination import Examination

    def scores(scenario: str, name: str, pace: str, entry: dict[str, Any]) -> dict[str, float]:
        words = entry["command"].split()
        seed = int(words[words.index("--seed") + 1])
        exam = Examination(scenario, pace, entry["episodes"], 2 * seed + 1)  # the draws after those of the search
        return exam.judge(tuned.controller_of(name, entry, tuned.TABLE))._asdict()

    text = tuned.TABLE.read_text("utf-8")
    for scenario, controllers in tuned.read_table().items():
        for name, found in controllers.items():
            for pace, entry in found.items():
                begin = text.index(f"[{scenario}.{name}.{pace}]")
                head, word, rest = text[begin:].partition("gains = ")
                for score, value in scores(scenario, name, pace, dict(entry)).items():
                    head = head.replace(f"{score} = {entry[score]!r}", f"{score} = {value!r}")
                text = text[:begin] + head + word + rest
    write_text_atomic(tuned.TABLE, text)


def stages(runs: tyro.conf.Positional[Path]) -> None:
    """Train the policy whose stages act in the data sets, and export them to pter_gym/tools/datasets/stages.

    It takes five minutes of a core. The run is in RUNS/everything, which must not exist.
    """
    from pter_agents.algorithms import load_settings
    from pter_agents.checkpoints import checkpoints
    from pter_agents.exporting import export_run
    from pter_agents.training import PROGRESS, RUN, Arguments, train
    from pter_gym.tools.datasets.levels import STAGES, STAGES_TABLE

    run, kept = runs / "everything", runs / "kept"
    kept.mkdir(parents=True, exist_ok=True)
    settings: Any = load_settings("ppo")
    arguments = Arguments(algorithm="ppo", scenario="everything", pace="all", steps=STEPS, seed=0, settings=settings)

    def keep(_: int = 0) -> None:
        for path in checkpoints(run):
            if not (kept / path.name).exists():
                shutil.copy(path, kept)

    train(arguments, run, on_progress=keep)
    keep()
    reached = {int(path.stem.split("-")[1]): path for path in checkpoints(kept)}
    wanted = [steps for steps in reached if steps % EVERY == 0 and steps + EVERY // 2 < STEPS] + [max(reached)]
    text = (
        f"# Made by `python docs/make/store.py stages RUNS`; σ is `deviation`, ρ is `persistence`.\n\nsteps = {STEPS}\n"
        f'command = "pter train ppo --scenario everything --steps {STEPS} --seed 0"\n'
        f"persistence = {settings.persistence}\n\n[medium]\n"
    )
    text += "".join(f'{scenario} = "{name}"\n' for scenario, name in MEDIUM.items())
    for number, steps in enumerate(wanted):
        name, deviation = f"stage-{number}", settings.deviation_at(min(steps / STEPS, 1.0))
        folder = runs / name
        folder.mkdir(exist_ok=True)
        for path in (run / RUN, run / PROGRESS, reached[steps]):
            shutil.copy(path, folder)
        export_run(folder, STAGES, name=name)
        text += f'\n[[stages]]\nname = "{name}"\nsteps = {steps}\ndeviation = {deviation:.6g}\n'
    write_text_atomic(STAGES / STAGES_TABLE, text)


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({each.__name__: each for each in (episodes, paces, gains, stages)})
