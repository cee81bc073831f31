"""Train a policy on the batch engine, in its own folder."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pter_agents.ppo import PPO
from pter_agents.runs import RunFolder
from pter_agents.settings import Arguments
from pter_agents.validation import Validation
from pter_agents.worlds import make_training
from pter_gym._internal.files import FilePath, remove_leftovers
from pter_gym._internal.terminal import make_folder
from pter_gym.errors import ParameterError, PterError, StorageError


class TrainingDivergedError(PterError, ArithmeticError):
    """A loss or a weight is no longer a finite number; the message names the last good checkpoint."""


def train(
    arguments: Arguments, out: FilePath, *, resume: bool = False, on_progress: Callable[[int], None] = lambda _: None
) -> Path:
    """Train a policy and return its last checkpoint.

    Parameters
    ----------
    arguments
        What to train. With ``resume``, they must equal those of the run in the folder, except for the steps.
    out
        Folder of the run.
    resume
        Whether to continue from the newest checkpoint in the folder.
    on_progress
        Called with the decisions so far after each rollout.

    Raises
    ------
    ParameterError
        If the folder already holds a run, or none to resume, or a different one, or another process trains in it.
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
        if not resume:
            folder.begin(arguments, training.interface)
        try:
            model = PPO(arguments.settings, training, arguments.steps, arguments.seed)
            if resume and folder.checkpoints():
                steps, state = folder.load()
                model.set_state(state, steps)
            return _learn(arguments, model, folder, on_progress)
        finally:
            training.env.close()


def _learn(arguments: Arguments, model: PPO, folder: RunFolder, on_progress: Callable[[int], None]) -> Path:
    """Train a model for all its steps, with checkpoints and validation, and return its last checkpoint."""
    validation = Validation(arguments.scenario, arguments.paces, arguments.validation_episodes, arguments.machine)
    rows: list[dict[str, Any]] = folder.progress(model.steps)

    def save() -> Path:
        folder.write_progress(rows)
        return folder.save(model.steps, model.get_state())

    def validate() -> None:
        folder.add_scores(model.steps, validation.scores(model.policy(), arguments.nominal))

    try:
        while model.steps < arguments.steps:
            rollouts = model.steps // model.rollout
            if rollouts % arguments.checkpoint_every == 0:
                save()
            if rollouts and rollouts % arguments.validate_every == 0:
                validate()
            values = model.advance()
            rows.append({"steps": model.steps, **values})
            on_progress(model.steps)
        validate()
        return save()
    except FloatingPointError as error:
        raise TrainingDivergedError(_stopped(model, folder, error)) from error
    except OSError as error:
        raise StorageError(_stopped(model, folder, error)) from error


def _stopped(model: PPO, folder: RunFolder, error: Exception) -> str:
    newest = "".join(f"; the newest checkpoint is {path}" for _, path in folder.checkpoints()[-1:])
    return f"training stopped after {model.steps} steps: {error}{newest}"


def check_same(known: Arguments, given: Arguments) -> None:
    """Raise a ParameterError if a run is resumed with different arguments, but for the steps."""
    pairs: list[tuple[Any, Any]] = [(replace(known, steps=given.steps), given), (known.settings, given.settings)]
    for before, after in pairs:
        for name in before.__dataclass_fields__.keys() - {"settings"}:
            one, other = getattr(before, name), getattr(after, name)
            if one != other:
                raise ParameterError(f"{name} is {one!r:.200} in the run that is in the folder, got {other!r:.200}")
