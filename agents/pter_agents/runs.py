"""A run's folder: what is trained (``run.json``), checkpoints, scores and progress."""

import json
import logging
import re
from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors, save as save_tensors

from pter_agents.draws import PaceScores
from pter_agents.settings import TrainingArguments, arguments_from
from pter_gym._internal.files import FilePath, expand_path, write_bytes_atomic, write_text_atomic
from pter_gym._internal.locks import LOCK, locked
from pter_gym._internal.reading import MAX_JSON_SIZE, parse_json, read_bytes, reading
from pter_gym._version import __version__
from pter_gym.benchmark.boards import is_ranked
from pter_gym.errors import DataError, ParameterError
from pter_gym.policies import Interface, TrainedController
from pter_gym.policies._files import RUN, interface_codec

SCORES, PROGRESS = "validation.json", "progress.csv"
"""Files of a run: its scores, and their table."""

PROGRESS_COLUMNS = ("seconds", "steps", "pace", "path_error_m", "completed", "ranked")
"""Of that table; ``ranked`` is True or False."""

VERSIONS = "versions"
"""Part of a run's description: versions of packages, one table for each that trained."""

KEPT_CHECKPOINTS = 2
"""Newest checkpoints that are kept."""

MAX_CHECKPOINT = 1 << 31
"""Largest checkpoint that is read [B]."""

PACKAGES = ("pter-gym", "jax", "numba", "numpy", "optax")
"""Whose versions a run names: with others, it has other bits."""

CHECKPOINT = re.compile(r"checkpoint-(\d+)\.safetensors")

Tensors = Mapping[str, NDArray[Any]]
"""Arrays of a training's state by name."""


class RunFolder:
    """A run's folder at ``path``."""

    def __init__(self, path: FilePath) -> None:
        self.path = expand_path("path", path)

    def lock(self) -> AbstractContextManager[None]:
        """Lock the folder, or raise a ParameterError if another process trains in it."""
        return locked(self.path / LOCK, busy=f"out: another process trains in {str(self.path)!r}")

    def begin(self, arguments: TrainingArguments, interface: Interface) -> None:
        """Write what is trained, or raise a ParameterError if the folder already holds a run."""
        if (self.path / RUN).exists():
            raise ParameterError(
                f"out already holds a run, {self.path}: give --resume or another folder"
            )
        plain = interface_codec().to_plain(interface)
        self._describe({**arguments.as_json(), "interface": plain, VERSIONS: [versions_now()]})

    def resume(self) -> None:
        """Note the packages' versions if they differ from those so far, with a warning."""
        content, now = self._content(), versions_now()
        before: list[dict[str, str]] = content.get(VERSIONS, [])
        last = before[-1] if before else {}
        if changed := [name for name in now if now[name] != last.get(name)]:
            logging.getLogger("pter_gym").warning(
                "%s goes on with %s, so not with the bits of a training that was not interrupted",
                self.path,
                ", ".join(f"{name} {now[name]} for {last.get(name, '?')}" for name in changed),
            )
            self._describe({**content, VERSIONS: [*before, now]})

    def versions(self) -> dict[str, str]:
        """Return the packages' versions of the training, in order where there were several."""
        with reading(f"{self.path / RUN} cannot be read"):
            told: list[dict[str, str]] = self._content().get(VERSIONS, [])
            names = dict.fromkeys(name for each in told for name in each)
            return {
                name: ", then ".join(dict.fromkeys(str(each.get(name, "?")) for each in told))
                for name in names
            }

    def _describe(self, content: Mapping[str, Any]) -> None:
        write_text_atomic(self.path / RUN, json.dumps(content, indent=2, allow_nan=False) + "\n")

    def _content(self) -> dict[str, Any]:
        return parse_json(read_bytes(self.path / RUN, MAX_JSON_SIZE))

    def read(self) -> tuple[TrainingArguments, Interface]:
        """Return what is trained, or raise a ParameterError if there is no run, a DataError if its
        description cannot be read."""
        file = self.path / RUN
        if not file.exists():
            raise ParameterError(f"there is no run in {self.path}: {RUN} is missing")
        with reading(f"{file} cannot be read"):
            content = self._content()
            content.pop(VERSIONS, None)
            interface = interface_codec().from_plain(content.pop("interface"))
            return arguments_from(content), interface

    def checkpoints(self) -> list[tuple[int, Path]]:
        """Return the checkpoints and the steps before each, the newest last."""
        matches = (CHECKPOINT.fullmatch(path.name) for path in self.path.glob("*"))
        return sorted((int(match[1]), self.path / match[0]) for match in matches if match)

    def save(self, steps: int, state: Tensors) -> Path:
        """Write a checkpoint and delete all but the newest, or raise a StorageError."""
        path = self.path / f"checkpoint-{steps}.safetensors"
        write_bytes_atomic(path, save_tensors(dict(state)))
        for _, old in self.checkpoints()[:-KEPT_CHECKPOINTS]:
            old.unlink(missing_ok=True)
        return path

    def load(self) -> tuple[int, Tensors]:
        """Return the steps before the newest checkpoint, and its state, or raise a DataError."""
        checkpoints = self.checkpoints()
        if not checkpoints:
            raise DataError(f"there is no checkpoint in {self.path}")
        steps, path = checkpoints[-1]
        with reading(f"checkpoint {path} cannot be read"):
            try:
                return steps, load_tensors(read_bytes(path, MAX_CHECKPOINT))
            except SafetensorError as error:
                raise ValueError(str(error)) from None

    def scores(self) -> dict[int, PaceScores]:
        """Return the validation scores by number of steps and by pace, or raise a DataError."""
        file = self.path / SCORES
        if not file.exists():
            return {}
        with reading(f"{file} cannot be read"):
            content = parse_json(read_bytes(file, MAX_JSON_SIZE))
            return {int(steps): row for steps, row in content.items()}

    def progress(self, steps: int) -> list[str]:
        """Return the lines of the table up to a number of steps, below its head."""
        file = self.path / PROGRESS
        lines = file.read_text("utf-8").splitlines()[1:] if file.exists() else []
        return [line for line in lines if int(line.split(",")[1]) <= steps]

    def add_scores(self, steps: int, seconds: float, scores: PaceScores) -> None:
        """Add the scores of a validation to both files; any of later steps are dropped."""
        kept = {before: row for before, row in self.scores().items() if before < steps}
        write_text_atomic(self.path / SCORES, json.dumps({**kept, steps: scores}, indent=1) + "\n")
        lines = [",".join(PROGRESS_COLUMNS), *self.progress(steps - 1)]
        for pace, each in scores.items():
            row = round(seconds, 1), steps, pace, each["path_error_m"], each["completed"]
            lines.append(",".join(map(str, (*row, is_ranked(each)))))
        write_text_atomic(self.path / PROGRESS, "\n".join(lines) + "\n")


def versions_now() -> dict[str, str]:
    """Return the versions of ``PACKAGES`` that are installed."""
    return {name: __version__ if name == "pter-gym" else version(name) for name in PACKAGES}


def policy_of(
    interface: Interface,
    state: Tensors,
    name: str = "policy",
    about: Mapping[str, Any] | None = None,
) -> TrainedController:
    """Return the policy of a training's state, as ``pter_agents.ppo.PPO.get_state`` returns it."""
    count = sum(each.startswith(".weights.policy") for each in state) // 2
    parts = ([state[f".weights.policy[{k}][{part}]"] for part in (0, 1)] for k in range(count))
    layers = tuple((np.ascontiguousarray(weight.T), bias) for weight, bias in parts)
    return TrainedController(interface, layers, name, about or {})
