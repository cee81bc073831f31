"""The jobs that write, for the campaign that kills them: what each does, what is finished, and what must come out."""

import hashlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

JOURNAL, GAINS, TRIALS = "a #?%b.db", "gains.toml", 5
"""Of the search for gains: its files and its trials."""

Digests = dict[str, str]
Kept = Mapping[str, object]
NOTHING: Kept = MappingProxyType({})


class Job(NamedTuple):
    """Something that writes.

    Attributes
    ----------
    work
        Does it in a folder, or goes on with it there, and returns the exit status.
    finished
        What is finished in a folder, by name; raises unless all that is there is whole.
    results
        What must be the same at the end, by name. What is finished under such a name is so at once.
    forkable
        Whether a process that has done it may fork: not with JAX, whose threads hold locks.
    """

    work: Callable[[Path], int]
    finished: Callable[[Path], Kept]
    results: Callable[[Path], Kept]
    forkable: bool = True


def digests(folder: Path, pattern: str = "**/*") -> Digests:
    """SHA-256 of the files in a folder by name, without logs and what is hidden."""
    found = sorted(path.relative_to(folder) for path in folder.glob(pattern) if path.is_file())
    return {
        str(path): hashlib.sha256((folder / path).read_bytes()).hexdigest()
        for path in found
        if not path.name.startswith(("progress", "events")) and not any(part.startswith(".") for part in path.parts)
    }


def command(*words: str) -> Callable[[Path], int]:
    """A command of `pter`; FOLDER in its words is the folder."""

    def work(folder: Path) -> int:
        from pter_gym._commands.main import main

        return main([word.replace("FOLDER", str(folder)) for word in words])

    return work


def train(folder: Path) -> int:
    """Train for six rollouts, with a checkpoint after each."""
    from pter_agents import prepare, training
    from pter_agents.algorithms import load_settings, settings_from
    from pter_gym.errors import PterError

    prepare.SAMPLE_WORLDS, prepare.SAMPLE_STEPS = 16, 20
    small = {"worlds": 16, "steps": 8, "contexts": 4, "hidden": [8], "value_hidden": [8], "episode": 20}
    arguments = training.Arguments(
        algorithm="residual",
        scenario="standard",
        pace="brisk",
        steps=6 * 16 * 8,
        seed=3,
        settings=settings_from("residual", {**vars(load_settings("residual")), **small, "minibatch": 64, "epochs": 2}),
        checkpoint_every=1,
        validate_every=2,
        validation_episodes=2,
    )
    run = folder / "run"
    try:
        training.train(arguments, run, resume=(run / training.RUN).exists())
    except PterError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    return 0


def trained(folder: Path) -> Kept:
    """Return the checkpoints that were reached; description, scores and checkpoints must be whole."""
    from pter_agents.checkpoints import checkpoints, read_checkpoint, steps_of
    from pter_agents.training import RUN, RunFolder

    run = folder / "run"
    if not (run / RUN).exists():
        return {}
    RunFolder(run).read()
    RunFolder(run).scores()
    steps = [0]
    for path in checkpoints(run):
        assert read_checkpoint(path)
        steps.append(steps_of(path))
    return {str(step): "reached" for step in range(0, steps[-1] + 1, 16 * 8)}


def tuned(folder: Path) -> Kept:
    """Return the finished trials; the journal and the file of gains must be whole."""
    from pter_gym.benchmark.tuned import read_table
    from pter_gym.tools.tuning.search import open_journal

    if (folder / GAINS).exists():
        read_table(folder / GAINS)
    if not (folder / JOURNAL).exists():
        return {}
    storage = open_journal(folder / JOURNAL)
    trials = [trial for study in storage.get_all_studies() for trial in storage.get_all_trials(study._study_id)]
    return {str(trial.number): (trial.params, trial.value) for trial in trials if trial.value is not None}


def commanded(folder: Path) -> Kept:
    """Return what was asked for; which gains come out depends on when a search was stopped."""
    from pter_gym.benchmark.tuned import read_table

    assert len(tuned(folder)) >= TRIALS
    return {"command": read_table(folder / GAINS)["standard"]["impedance"]["brisk"]["command"]}


def benchmarked(folder: Path) -> Kept:
    """Return the runs that are finished, and the pictures; none may be left out."""
    from pter_gym.benchmark._results import SUMMARY, ResultsFolder

    left_out = ResultsFolder(folder).read().left_out
    assert not left_out, left_out
    return {name: digest for name, digest in digests(folder).items() if name != SUMMARY}


def exported(folder: Path) -> Kept:
    """Return what is written of a policy; if its card is there, which is the last, it must be a whole one."""
    from pter_gym.policies import read_policy

    if (folder / "policies" / "mine.json").exists():
        read_policy("mine", folder / "policies")
    return digests(folder)


def jobs(work: Path) -> dict[str, Job]:
    """Return all jobs by name; what they need is made in a folder."""

    def writer(*words: str) -> Job:
        """Job whose files are there as they are in the end, or not at all."""
        return Job(command(*words), digests, digests)

    trial = ("--trials", str(TRIALS), "--starts", "1", "--episodes", "4", "--pace", "brisk")
    few = ("--policies", "locked,impedance", "--paces", "brisk", "--episodes", "4")
    few_steps = ("--scenario", "standard", "--level", "random", "--steps", "300")
    return {
        "train": Job(train, trained, digests, forkable=False),
        "export": Job(
            command("export", str(work / "run"), "--name", "mine", "--out", "FOLDER/policies"), exported, digests
        ),
        "tune": Job(
            command("tune", "impedance", *trial, "--storage", f"FOLDER/{JOURNAL}", "--out", f"FOLDER/{GAINS}"),
            tuned,
            commanded,
        ),
        "benchmark": Job(command("benchmark", "--no-film", *few, "--out", "FOLDER"), benchmarked, digests),
        "record": writer("record", *few_steps, "--out", "FOLDER"),
        "fit": writer("fit", "--budget", "1000", "--out", "FOLDER/preset.toml"),
        "reproduce": writer("reproduce", "fig3", "--out", "FOLDER"),
    }
