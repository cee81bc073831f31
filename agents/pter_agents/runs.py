"""A run's folder: what is trained (``run.json``), checkpoints, scores and progress."""

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors, save as save_tensors

from pter_agents.settings import TrainingArguments, arguments_from
from pter_gym._internal.files import FilePath, expand_path, write_bytes_atomic, write_text_atomic
from pter_gym._internal.locks import LOCK, locked
from pter_gym._internal.reading import MAX_JSON_SIZE, parse_json, read_bytes, reading
from pter_gym.errors import DataError, ParameterError
from pter_gym.policies import Interface, TrainedPolicy
from pter_gym.policies._files import RUN, interface_codec

SCORES, PROGRESS = "validation.json", "progress.csv"
"""Files of a run: its scores, their table, and one that the training process has locked."""

KEPT = 2
"""Newest checkpoints that are kept."""

MAX_CHECKPOINT = 1 << 31
"""Largest checkpoint that is read [B]."""

CHECKPOINT = re.compile(r"checkpoint-(\d+)\.safetensors")

State = dict[str, NDArray[Any]]
"""Arrays of a training's state by name."""


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
        object.__setattr__(self, "path", expand_path("path", path))

    def lock(self) -> AbstractContextManager[None]:
        """Lock the folder, or raise a ParameterError if another process trains in it."""
        return locked(self.path / LOCK, busy=f"out: another process trains in {str(self.path)!r}")

    def begin(self, arguments: TrainingArguments, interface: Interface) -> None:
        """Write what is trained, or raise a ParameterError if the folder already holds a run."""
        if (self.path / RUN).exists():
            raise ParameterError(
                f"out holds a run already, {self.path}: give --resume, or another folder"
            )
        content = {**arguments.as_json(), "interface": interface_codec().to_plain(interface)}
        write_text_atomic(self.path / RUN, json.dumps(content, indent=2, allow_nan=False) + "\n")

    def read(self) -> tuple[TrainingArguments, Interface]:
        """Return what is trained.

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
        with reading(f"{file} cannot be read"):
            content = parse_json(read_bytes(file, MAX_JSON_SIZE))
            interface = interface_codec().from_plain(content.pop("interface"))
            return arguments_from(content), interface

    def checkpoints(self) -> list[tuple[int, Path]]:
        """Return the checkpoints and the steps before each, the newest last."""
        matches = (CHECKPOINT.fullmatch(path.name) for path in self.path.glob("*"))
        return sorted((int(match[1]), self.path / match[0]) for match in matches if match)

    def save(self, steps: int, state: State) -> Path:
        """Write a checkpoint and delete all but the newest.

        Raises
        ------
        StorageError
            If it cannot be written; earlier ones are kept.
        """
        path = self.path / f"checkpoint-{steps}.safetensors"
        write_bytes_atomic(path, save_tensors(state))
        for _, old in self.checkpoints()[:-KEPT]:
            old.unlink(missing_ok=True)
        return path

    def load(self) -> tuple[int, State]:
        """Return the number of steps before the newest checkpoint, and its state.

        Raises
        ------
        DataError
            If there is no checkpoint, or it cannot be read.
        """
        checkpoints = self.checkpoints()
        if not checkpoints:
            raise DataError(f"there is no checkpoint in {self.path}")
        steps, path = checkpoints[-1]
        with reading(f"checkpoint {path} cannot be read"):
            try:
                return steps, load_tensors(read_bytes(path, MAX_CHECKPOINT))
            except SafetensorError as error:
                raise ValueError(str(error)) from None

    def scores(self) -> dict[int, dict[str, dict[str, float]]]:
        """Return the validation scores by number of steps and by pace, or raise a DataError."""
        file = self.path / SCORES
        if not file.exists():
            return {}
        with reading(f"{file} cannot be read"):
            return {
                int(steps): row
                for steps, row in parse_json(read_bytes(file, MAX_JSON_SIZE)).items()
            }

    def add_scores(self, steps: int, scores: Mapping[str, Mapping[str, float]]) -> None:
        """Add validation scores to the file; any of later steps are dropped."""
        kept = {before: row for before, row in self.scores().items() if before < steps}
        write_text_atomic(self.path / SCORES, json.dumps({**kept, steps: scores}, indent=1) + "\n")

    def add_progress(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Add rows of one validation to the table; any of later steps are dropped."""
        kept = self.progress(rows[0]["steps"] - 1)
        table = io.StringIO()
        writer = csv.DictWriter(table, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows([*kept, *rows])
        write_text_atomic(self.path / PROGRESS, table.getvalue())

    def progress(self, steps: int) -> list[dict[str, str]]:
        """Return the rows of the table up to a number of steps."""
        file = self.path / PROGRESS
        if not file.exists():
            return []
        with file.open(encoding="utf-8", newline="") as text:
            return [row for row in csv.DictReader(text) if int(row["steps"]) <= steps]


def policy_of(
    interface: Interface, state: State, name: str = "policy", about: Mapping[str, Any] | None = None
) -> TrainedPolicy:
    """Return the policy of a training's state, as ``pter_agents.ppo.PPO.get_state`` returns it."""
    count = sum(each.startswith(".weights.policy") for each in state) // 2
    parts = ([state[f".weights.policy[{k}][{part}]"] for part in (0, 1)] for k in range(count))
    layers = tuple((np.ascontiguousarray(weight.T), bias) for weight, bias in parts)
    return TrainedPolicy(interface, layers, name, about or {})
