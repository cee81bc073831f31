"""Train a policy: an algorithm of Stable-Baselines3 on the batch engine, in a folder of its own."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import CSVOutputFormat, Logger, TensorBoardOutputFormat
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from pter_agents.algorithms import Learner, find_algorithm, settings_from
from pter_agents.checkpoints import checkpoints, resume_from, save_checkpoint
from pter_agents.errors import TrainingDivergedError
from pter_agents.prepare import make_interface, sample_truth
from pter_agents.settings import Settings, require_whole
from pter_agents.validation import Validation, network_of
from pter_agents.worlds import ALL, InterfaceVecEnv, make_worlds, training_draws
from pter_gym.benchmark import PACES
from pter_gym.errors import DataError, ParameterError, unknown_name
from pter_gym.internal.files import write_text_atomic
from pter_gym.internal.terminal import make_folder
from pter_gym.params import require, require_number
from pter_gym.policies.cards import plain_interface, read_interface
from pter_gym.policies.interface import Interface
from pter_gym.scenarios import SCENARIOS
from pter_gym.scenarios.randomisation import Randomisation

RUN = "run.json"
"""File in a run's folder that says what is trained; checkpoints and logs are beside it."""

PROGRESS = "validation.json"
"""File in a run's folder with the scores during training."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """What to train.

    Attributes
    ----------
    algorithm
        One of ``pter_agents.algorithms.ALGORITHMS``.
    scenario, pace
        Names; the pace may be ``"all"``.
    steps
        Control steps of all worlds together; rounded up to whole rollouts.
    seed
        Seed ≥ 0 of weights, worlds, training draws and actions.
    settings
        Hyper-parameters.
    checkpoint_every, validate_every
        Rollouts between two checkpoints, and between two validations.
    validation_episodes
        Episodes of a validation at each pace.
    """

    algorithm: str
    scenario: str
    pace: str
    steps: int
    seed: int
    settings: Settings
    checkpoint_every: int = 10
    validate_every: int = 40
    validation_episodes: int = 64

    def __post_init__(self) -> None:
        """Check names and numbers."""
        find_algorithm(self.algorithm)
        for name, known in (("scenario", SCENARIOS), ("pace", (ALL, *PACES))):
            if getattr(self, name) not in known:
                raise unknown_name(name, getattr(self, name), known)
        for name in ("steps", "checkpoint_every", "validate_every", "validation_episodes"):
            require_whole(self, name)
        require_number(self, "seed", at_least=0, below=2**31)
        require(type(self.seed) is int, self, "seed", self.seed, "a whole number")

    @property
    def learner(self) -> Learner:
        """How the algorithm learns."""
        return find_algorithm(self.algorithm).learner

    @property
    def paces(self) -> tuple[str, ...]:
        """Names of the commanded paces that are trained."""
        return tuple(PACES) if self.pace == ALL else (self.pace,)


@dataclass(frozen=True)
class RunFolder:
    """A run's folder.

    Attributes
    ----------
    path
        Where it is.
    """

    path: Path

    def begin(self, arguments: Arguments, interface: Interface) -> None:
        """Write what is to be trained, or raise a ParameterError if there is a run in the folder already."""
        make_folder(self.path)
        if (self.path / RUN).exists():
            raise ParameterError(f"out holds a run already, {self.path}: give --resume, or another folder")
        content = {**asdict(arguments), "interface": plain_interface(interface)}
        write_text_atomic(self.path / RUN, json.dumps(content, indent=2, allow_nan=False) + "\n")

    def read(self) -> tuple[Arguments, Interface]:
        """Return what is trained here.

        Raises
        ------
        ParameterError
            If there is no run in the folder.
        DataError
            If its description was changed to something that makes no sense.
        """
        try:
            content = json.loads((self.path / RUN).read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise ParameterError(f"there is no run in {self.path}: {RUN} is missing") from None
        except (OSError, ValueError) as error:
            raise DataError(f"{self.path / RUN} cannot be read: {error}") from None
        try:
            interface = read_interface(content.pop("interface"))
            settings = settings_from(content["algorithm"], content.pop("settings"))
            return Arguments(settings=settings, **content), interface
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{self.path / RUN} is not what was written: {error}") from None

    def newest(self) -> Path | None:
        """Return the newest checkpoint, or None."""
        found = checkpoints(self.path)
        return found[-1] if found else None


class Watch(BaseCallback):
    """Between two rollouts: checkpoints, validation, and progress."""

    def __init__(
        self, arguments: Arguments, worlds: InterfaceVecEnv, folder: RunFolder, on_progress: Callable[[int], None]
    ) -> None:
        super().__init__()
        self._arguments = arguments
        self._worlds = worlds
        self._folder = folder
        self._on_progress = on_progress
        self._validation = Validation(
            arguments.scenario, arguments.paces, arguments.validation_episodes, arguments.settings.sensors
        )

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        """Do what is due at the rollout's boundary."""
        settings = self._arguments.settings
        rollouts = self._steps // (settings.worlds * settings.steps)
        self._on_progress(self._steps)
        if rollouts % self._arguments.checkpoint_every == 0:
            save_checkpoint(self._trained, self._worlds, self._folder.path)
        if rollouts and rollouts % self._arguments.validate_every == 0:
            self.validate()

    def finish(self) -> Path:
        """Keep the last checkpoint and validate it."""
        self._on_progress(self._steps)
        path = save_checkpoint(self._trained, self._worlds, self._folder.path)
        self.validate()
        return path

    def validate(self) -> None:
        """Write the scores on validation episodes to the logs and to a file."""
        actor = self._arguments.learner.actor(self._trained)
        scores = self._validation.scores(network_of(actor), self._worlds.interface)
        for pace, values in scores.items():
            for name, value in values.items():
                self.logger.record(f"validation/{pace}_{name}", value)
        self.logger.dump(self._steps)
        file = self._folder.path / PROGRESS
        kept: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        kept = {steps: row for steps, row in kept.items() if int(steps) < self._steps}
        kept[str(self._steps)] = scores
        write_text_atomic(file, json.dumps(kept, indent=1) + "\n")

    @property
    def _trained(self) -> OnPolicyAlgorithm:
        assert isinstance(self.model, OnPolicyAlgorithm)
        return self.model

    @property
    def _steps(self) -> int:
        """Control steps so far: the model's, since a finished run that is resumed has no steps of this callback."""
        return self._trained.num_timesteps


def train(
    arguments: Arguments, out: Path, *, resume: bool = False, on_progress: Callable[[int], None] = lambda _: None
) -> Path:
    """Train a policy and return its last checkpoint.

    Parameters
    ----------
    arguments
        What to train. With ``resume`` they must be those of the run in the folder, except for the steps.
    out
        Folder of the run.
    resume
        Whether to go on from the newest checkpoint in the folder.
    on_progress
        Called with the control steps so far at each rollout's boundary.

    Raises
    ------
    ParameterError
        If there is a run already, or none to resume, or another one.
    TrainingDivergedError
        If a loss or a weight is no longer finite; it names the last good checkpoint.
    """
    folder = RunFolder(out)
    settings = arguments.settings
    draws = training_draws(
        arguments.scenario, arguments.pace, contexts=settings.contexts, seed=arguments.seed, reward=settings.reward()
    )
    if resume:
        known, interface = folder.read()
        check_same(known, arguments)
    else:
        interface = make_interface(settings, arguments.scenario, draws, arguments.seed)
        folder.begin(arguments, interface)
    worlds = make_training_worlds(settings, draws, interface, arguments.seed)
    model = make_model(settings, worlds, arguments)
    newest = folder.newest() if resume else None
    if newest is not None:
        resume_from(model, worlds, newest)
    model.set_logger(make_logger(out, cast(Any, model).num_timesteps))
    watch = Watch(arguments, worlds, folder, on_progress)
    try:
        remaining = arguments.steps - model.num_timesteps
        if remaining > 0:
            model.learn(remaining, callback=watch, reset_num_timesteps=newest is None, log_interval=1)
        else:
            watch.init_callback(model)
        return watch.finish()
    except FloatingPointError as error:
        good = folder.newest()
        raise TrainingDivergedError(
            f"training stopped after {model.num_timesteps} steps: {error}; the last good checkpoint is {good}"
        ) from error
    finally:
        model.logger.close()
        worlds.close()


def make_training_worlds(settings: Settings, draws: Randomisation, interface: Interface, seed: int) -> InterfaceVecEnv:
    """Return worlds as the networks meet them.

    Parameters
    ----------
    settings, draws, seed
        As in ``make_interface``.
    interface
        What the policy sees and does.
    """
    truth = sample_truth(settings, draws, seed) if settings.privileged else None
    worlds = make_worlds(draws, settings.worlds, settings.episode, settings.sensors)
    return InterfaceVecEnv(worlds, interface, truth)


def make_model(settings: Settings, worlds: InterfaceVecEnv, arguments: Arguments) -> OnPolicyAlgorithm:
    """Return an untrained model; seeds torch, NumPy's legacy generator and the worlds."""
    torch.set_num_threads(1)  # networks as small as these are slower with more
    return arguments.learner.make_model(settings, worlds, arguments.seed)


def make_logger(out: Path, steps: int) -> Logger:
    """Return what writes progress.csv and for TensorBoard; after a resume, to files of its own."""
    name = f"progress-{steps}.csv" if steps else "progress.csv"
    return Logger(str(out), [CSVOutputFormat(str(out / name)), TensorBoardOutputFormat(str(out))])


def check_same(known: Arguments, given: Arguments) -> None:
    """Raise a ParameterError if a run is resumed with other arguments than it was begun with."""
    if replace(known, steps=given.steps) == given:
        return
    before, after = plain(known), plain(given)
    other = next(name for name in before if name != "steps" and before[name] != after[name])
    raise ParameterError(f"{other} is {before[other]!r} in the run that is in the folder, got {after[other]!r}")


def plain(arguments: Arguments) -> Mapping[str, Any]:
    """Return arguments and hyper-parameters by name."""
    values = asdict(arguments)
    return {**values.pop("settings"), **values}
