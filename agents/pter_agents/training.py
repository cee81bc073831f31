"""Train a policy on the batch engine, in its own folder."""

import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.logger import CSVOutputFormat, Logger, TensorBoardOutputFormat

from pter_agents.algorithms import Learner, Model, find_algorithm, settings_from
from pter_agents.checkpoints import checkpoints, load_checkpoint, save_checkpoint
from pter_agents.errors import TrainingDivergedError
from pter_agents.prepare import make_interface, sample_truth
from pter_agents.settings import TrainingSettings
from pter_agents.validation import SCORES, Scores, Validation
from pter_agents.worlds import ALL, TrainingWorlds, draws_for, make_worlds
from pter_gym import params
from pter_gym._internal.codec import Codec, dataclasses_in
from pter_gym._internal.files import FilePath, find_path, remove_leftovers, write_text_atomic
from pter_gym._internal.locks import locked
from pter_gym._internal.reading import MOST_JSON, parse_json, read_bytes, reading
from pter_gym._internal.terminal import make_folder
from pter_gym.benchmark import PACES
from pter_gym.errors import ParameterError, StorageError, unknown_name
from pter_gym.params import BASELINE, Machine, require_kind, require_whole
from pter_gym.policies import NeuralPolicy
from pter_gym.policies._cards import read_interface
from pter_gym.policies._interface import BoundInterface, Interface
from pter_gym.scenarios import SCENARIOS
from pter_gym.scenarios._own_machine import OwnMachine
from pter_gym.scenarios.randomisation import Mixture, Randomisation

RUN = "run.json"
"""File in a run's folder that says what is trained; checkpoints and logs are beside it."""

PROGRESS = "validation.json"
"""File in a run's folder with the scores during training."""

CODEC = Codec((*dataclasses_in(params), OwnMachine))
"""Stores the machine of a training."""

LOCK = ".lock"
"""File in a run's folder that the training process has locked."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments of a training run.

    Attributes
    ----------
    algorithm
        One of ``pter_agents.algorithms.ALGORITHMS``.
    scenario, pace
        Names; both may be ``"all"``.
    steps
        Total decisions in all worlds; rounded up to whole rollouts.
    seed
        Seed ≥ 0 of weights, worlds, training draws and actions.
    settings
        Hyper-parameters.
    checkpoint_every, validate_every
        Rollouts between two checkpoints, and between two validations.
    validation_episodes
        Episodes of a validation at each pace.
    machine
        A machine in place of those that the scenario draws; None draws them.
    """

    algorithm: str
    scenario: str
    pace: str
    steps: int
    seed: int
    settings: TrainingSettings
    checkpoint_every: int = 10
    validate_every: int = 40
    validation_episodes: int = 64
    machine: OwnMachine | None = None

    def __post_init__(self) -> None:
        """Check names and numbers."""
        find_algorithm(self.algorithm)
        for name, known in (("scenario", (ALL, *SCENARIOS)), ("pace", (ALL, *PACES))):
            if getattr(self, name) not in known:
                raise unknown_name(name, getattr(self, name), known)
        for name in ("steps", "checkpoint_every", "validate_every", "validation_episodes"):
            require_whole(self, name)
        require_whole(self, "seed", at_least=0, below=2**31)
        require_kind(self, "machine", OwnMachine, type(None))

    @property
    def learner(self) -> Learner:
        """How the algorithm learns."""
        return find_algorithm(self.algorithm).learner

    @property
    def nominal(self) -> Machine:
        """The machine that a base controller is bound to."""
        return BASELINE if self.machine is None else self.machine.machine

    @property
    def paces(self) -> tuple[str, ...]:
        """Names of the commanded paces in training."""
        return tuple(PACES) if self.pace == ALL else (self.pace,)

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {**asdict(self), "machine": CODEC.to_plain(self.machine)}


def arguments_from(content: Mapping[str, Any]) -> Arguments:
    """Return arguments from plain data, as made by ``Arguments.as_json``."""
    values = dict(content)
    settings = settings_from(values["algorithm"], values.pop("settings"))
    return Arguments(settings=settings, machine=CODEC.from_plain(values.pop("machine", None)), **values)


@dataclass(frozen=True)
class RunFolder:
    """A run's folder.

    Attributes
    ----------
    path
        Where it is.
    """

    path: Path

    def __init__(self, path: FilePath) -> None:
        object.__setattr__(self, "path", find_path("path", path))

    def reserve(self) -> AbstractContextManager[None]:
        """Lock the folder, or raise a ParameterError if another process trains in it."""
        return locked(self.path / LOCK, busy=f"out: another process trains in {str(self.path)!r}")

    def begin(self, arguments: Arguments, interface: Interface) -> None:
        """Write the arguments, or raise a ParameterError if the folder already holds a run."""
        if (self.path / RUN).exists():
            raise ParameterError(f"out holds a run already, {self.path}: give --resume, or another folder")
        content = {**arguments.as_json(), "interface": asdict(interface)}
        write_text_atomic(self.path / RUN, json.dumps(content, indent=2, allow_nan=False) + "\n")

    def read(self) -> tuple[Arguments, Interface]:
        """Return the arguments of this run.

        Raises
        ------
        ParameterError
            If there is no run in the folder.
        DataError
            If its description cannot be read.
        """
        file = self.path / RUN
        if not file.exists():
            raise ParameterError(f"there is no run in {self.path}: {RUN} is missing")
        with reading(f"{file} is not what was written"):
            content = parse_json(read_bytes(file, MOST_JSON))
            interface = read_interface(content.pop("interface"))
            return arguments_from(content), interface

    def newest(self) -> Path | None:
        """Return the newest checkpoint, or None."""
        found = checkpoints(self.path)
        return found[-1] if found else None

    def scores(self) -> dict[int, Scores]:
        """Return the validation scores, by the control steps before each.

        Raises
        ------
        DataError
            If they cannot be read.
        """
        file = self.path / PROGRESS
        if not file.exists():
            return {}
        with reading(f"{file} cannot be read"):
            return {
                int(steps): {pace: {name: float(row[name]) for name in SCORES} for pace, row in scores.items()}
                for steps, scores in parse_json(read_bytes(file, MOST_JSON)).items()
            }


class Watch:
    """Work between rollouts: checkpoints, validation, logs."""

    def __init__(self, arguments: Arguments, model: Model, interface: BoundInterface, folder: RunFolder) -> None:
        self._arguments = arguments
        self._model = model
        self._interface = interface
        self._folder = folder
        csv = f"progress-{model.steps}.csv" if model.steps else "progress.csv"  # a resumed run has one of its own
        self._logger = Logger(
            str(folder.path),
            [CSVOutputFormat(str(folder.path / csv)), TensorBoardOutputFormat(str(folder.path))],
        )
        self._validation = Validation(
            arguments.scenario,
            arguments.paces,
            arguments.validation_episodes,
            arguments.settings.sensors,
            arguments.machine,
            **arguments.settings.seen,
        )

    def look(self) -> None:
        """Do the work that is due now."""
        rollouts = self._model.steps // self._model.rollout
        if rollouts % self._arguments.checkpoint_every == 0:
            save_checkpoint(self._model, self._folder.path)
        if rollouts and rollouts % self._arguments.validate_every == 0:
            self.validate()

    def log(self, values: Mapping[str, float]) -> None:
        """Write numbers to the logs."""
        for name, value in values.items():
            self._logger.record(name, value)
        self._logger.dump(self._model.steps)

    def finish(self) -> Path:
        """Save the last checkpoint and validate it."""
        path = save_checkpoint(self._model, self._folder.path)
        self.validate()
        return path

    def validate(self) -> None:
        """Write the scores on validation episodes to the logs and to a file."""
        scores = self._validation.scores(NeuralPolicy(self._interface, self._model.actor()))
        self.log({f"validation/{pace}_{name}": value for pace, row in scores.items() for name, value in row.items()})
        kept = {steps: row for steps, row in self._folder.scores().items() if steps < self._model.steps}
        kept[self._model.steps] = scores
        write_text_atomic(self._folder.path / PROGRESS, json.dumps(kept, indent=1) + "\n")

    def close(self) -> None:
        """Close the logs."""
        self._logger.close()


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
        Called with the control steps so far after each rollout.

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
    draws = make_draws(arguments)
    if resume:
        known, interface = folder.read()
        check_same(known, arguments)
    else:
        interface = make_interface(arguments.settings, arguments.scenario, draws, arguments.seed, arguments.nominal)
    make_folder(folder.path)
    with folder.reserve():
        if not resume:
            folder.begin(arguments, interface)
        remove_leftovers(folder.path)
        finished = folder.scores()
        worlds = make_training_worlds(arguments, draws, interface)
        model = make_model(arguments, worlds)
        try:
            newest = folder.newest() if resume else None
            if newest is not None:
                load_checkpoint(model, newest)
            on_progress(model.steps)
            if newest is not None and model.steps >= arguments.steps and model.steps in finished:
                return newest
            return _learn(arguments, model, Watch(arguments, model, worlds.interface, folder), on_progress)
        except FloatingPointError as error:
            raise TrainingDivergedError(
                f"training stopped after {model.steps} steps: {error}; the last good checkpoint is {folder.newest()}"
            ) from error
        except OSError as error:
            raise StorageError(
                f"training stopped after {model.steps} steps: {error}; the newest checkpoint is {folder.newest()}, "
                "from which --resume goes on"
            ) from error
        finally:
            model.close()
            worlds.close()


def _learn(arguments: Arguments, model: Model, watch: Watch, on_progress: Callable[[int], None]) -> Path:
    """Train a model for all its steps and return its last checkpoint."""
    try:
        while model.steps < arguments.steps:
            watch.look()
            watch.log(model.advance())
            on_progress(model.steps)
        return watch.finish()
    finally:
        with suppress(OSError):  # a log that cannot be closed must not hide another error
            watch.close()


def make_draws(arguments: Arguments, contexts: int | None = None) -> Randomisation | Mixture:
    """Return the machines and tasks to train on, or only the first ones."""
    settings = arguments.settings
    return draws_for(
        arguments.scenario,
        arguments.pace,
        contexts=contexts or settings.contexts,
        seed=arguments.seed,
        machine=arguments.machine,
        **settings.stated,
    )


def make_training_worlds(arguments: Arguments, draws: Randomisation | Mixture, interface: Interface) -> TrainingWorlds:
    """Return worlds with the networks' inputs and outputs."""
    settings = arguments.settings
    truth = sample_truth(settings, draws, arguments.seed) if settings.privileged else None
    worlds = make_worlds(draws, settings.worlds, settings.episode, settings.sensors, settings.frame_skip)
    return TrainingWorlds(worlds, interface, truth, arguments.nominal)


def make_model(arguments: Arguments, worlds: TrainingWorlds) -> Model:
    """Return an untrained model; this seeds torch."""
    torch.set_num_threads(1)  # networks as small as these are slower with more
    return arguments.learner.make_model(arguments.settings, worlds, arguments.steps, arguments.seed)


def check_same(known: Arguments, given: Arguments) -> None:
    """Raise a ParameterError if a run is resumed with different arguments."""
    told: list[tuple[Any, Any]] = [(known, given), (known.settings, given.settings)]
    for before, after in told:
        for name in before.__dataclass_fields__.keys() - {"settings"}:
            one, other = getattr(before, name), getattr(after, name)
            if one != other and (name != "steps" or before is not known):
                raise ParameterError(f"{name} is {one!r:.200} in the run that is in the folder, got {other!r:.200}")
