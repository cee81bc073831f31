"""Train a policy on the batch engine, in its own folder."""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tensorboard.summary import Writer

from pter_agents.ppo import PPO
from pter_agents.runs import RunFolder
from pter_agents.settings import TrainingArguments
from pter_agents.validation import Validation
from pter_agents.worlds import make_training
from pter_gym._internal.files import FilePath, remove_leftovers
from pter_gym._internal.terminal import make_folder
from pter_gym.benchmark.boards import COMPLETION, PACE_ERROR
from pter_gym.errors import ParameterError, PterError, StorageError
from pter_gym.policies._files import encode_policy


class TrainingDivergedError(PterError, ArithmeticError):
    """A loss or a weight is not finite; the message names the last good checkpoint."""


Scores = Mapping[str, Mapping[str, float]]
"""Mean validation scores by pace."""


def train(
    arguments: TrainingArguments,
    out: FilePath,
    *,
    resume: bool = False,
    on_progress: Callable[[int], None] = lambda _: None,
    on_scores: Callable[[int, Scores], None] = lambda _steps, _scores: None,
) -> Path:
    """Train a policy and return its last checkpoint.

    Parameters
    ----------
    arguments
        What to train. With ``resume``, they must equal those of the run in the folder, except for
        the steps.
    out
        Folder of the run.
    resume
        Whether to continue from the newest checkpoint in the folder.
    on_progress
        Called with the steps so far after each rollout.
    on_scores
        Called with the steps so far and the scores after each validation.

    Raises
    ------
    ParameterError
        If the folder already holds a run, or none to resume, or a different one, or another process
        trains in it; or if the policy could not be exported.
    DataError
        If a file of the run to resume cannot be read.
    StorageError
        If the folder can no longer be written to; the message names the newest checkpoint.
    TrainingDivergedError
        If a loss or a weight is no longer finite; the message names the last good checkpoint.
    """
    folder = RunFolder(out)
    if resume:
        check_same(folder.read()[0], arguments)
    make_folder(folder.path)
    with folder.lock():
        remove_leftovers(folder.path)
        training = make_training(arguments)
        try:
            model = PPO(arguments.settings, training, arguments.steps, arguments.seed)
            encode_policy(model.policy())
            if not resume:
                folder.begin(arguments, training.interface)
            if resume and folder.checkpoints():
                steps, state = folder.load()
                model.set_state(state, steps)
            return _learn(arguments, model, folder, on_progress, on_scores)
        finally:
            training.env.close()


def _learn(
    arguments: TrainingArguments,
    model: PPO,
    folder: RunFolder,
    on_progress: Callable[[int], None],
    on_scores: Callable[[int, Scores], None],
) -> Path:
    """Train a model with checkpoints and validation, and return its last checkpoint."""
    validation = Validation(
        arguments.scenario, arguments.paces, arguments.validation_episodes, arguments.machine
    )
    before = folder.progress(model.steps)
    begin = time.perf_counter() - (float(before[-1]["seconds"]) if before else 0.0)
    events = Writer(str(folder.path))

    def save() -> Path:
        return folder.save(model.steps, model.get_state())

    def validate() -> None:
        scores = validation.scores(model.policy())
        folder.add_scores(model.steps, scores)
        spent = {"seconds": round(time.perf_counter() - begin, 1), "steps": model.steps}
        folder.add_progress(
            [{**spent, "pace": pace, **progress_of(values)} for pace, values in scores.items()]
        )
        for pace, values in scores.items():
            for name in ("path_error_m", "completed"):
                events.add_scalar(f"{name}/{pace}", values[name], model.steps)
        events.flush()
        on_scores(model.steps, scores)

    try:
        while model.steps < arguments.steps:
            rollouts = model.steps // model.rollout
            if rollouts % arguments.checkpoint_every == 0:
                save()
            if rollouts and rollouts % arguments.validate_every == 0:
                validate()
            model.advance()
            on_progress(model.steps)
        validate()
        return save()
    except FloatingPointError as error:
        raise TrainingDivergedError(_stopped(model, folder, error)) from error
    except OSError as error:
        raise StorageError(_stopped(model, folder, error)) from error
    finally:
        with suppress(OSError):  # of a full disk, which has been told
            events.close()


def progress_of(scores: Mapping[str, float]) -> dict[str, Any]:
    """Return the path error [m], the share of arrivals, and whether they suffice for a rank."""
    off_pace = max(scores["mean_pace_error"], scores["segment_pace_error"])
    ranked = scores["completed"] >= COMPLETION and off_pace <= PACE_ERROR
    return {
        "path_error_m": scores["path_error_m"],
        "completed": scores["completed"],
        "ranked": ranked,
    }


def _stopped(model: PPO, folder: RunFolder, error: Exception) -> str:
    newest = "".join(f"; the newest checkpoint is {path}" for _, path in folder.checkpoints()[-1:])
    return f"training stopped after {model.steps} steps: {error}{newest}"


def check_same(known: TrainingArguments, given: TrainingArguments) -> None:
    """Raise a ParameterError if a run is resumed with arguments that differ in more than steps."""
    pairs: list[tuple[Any, Any]] = [
        (replace(known, steps=given.steps), given),
        (known.settings, given.settings),
    ]
    for before, after in pairs:
        for name in before.__dataclass_fields__.keys() - {"settings"}:
            one, other = getattr(before, name), getattr(after, name)
            if one != other:
                raise ParameterError(
                    f"{name} is {one!r:.200} in the run that is in the folder, got {other!r:.200}"
                )
