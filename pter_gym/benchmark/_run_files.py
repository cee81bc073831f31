"""The file of a run. Readers trust nothing in it: each part is checked, and errors say what is wrong.

A file holds a SHA-256 of its own name and everything in it, so edited, copied or renamed files are rejected. Scores
that somebody invents and hashes anew are found by ``pter verify``.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from textwrap import shorten
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.reading import MOST_JSON, parse_json, read_bytes, reading
from pter_gym.benchmark._runs import (
    INSTANTS,
    Conditions,
    Planning,
    Sample,
    ScenarioRun,
    check_name,
    code_digest,
    other_score,
    sample_numbers,
)
from pter_gym.benchmark.episodes import DERIVED, check_fresh, stored_checksum, strata_of
from pter_gym.benchmark.metrics import METRICS
from pter_gym.scenarios import find_pace

HASH = "sha256"
"""Name of the hash in a file."""


def run_path(folder: FilePath, conditions: Conditions) -> Path:
    """Return the file of a run in a folder of results."""
    name = "-".join((conditions.scenario, conditions.pace, conditions.policy, str(conditions.episodes)))
    name += episodes_suffix(conditions.fresh)
    name += f"-seed{conditions.seed}" if conditions.seed else ""
    return find_path("folder", folder) / "runs" / f"{quote(name, safe=' ')}.json"


def episodes_suffix(fresh: int | str | None) -> str:
    """Return the part of a file name that tells which episodes were run."""
    return "" if fresh is None else f"-{DERIVED}" if fresh == DERIVED else f"-fresh{fresh}"


def write_run(folder: FilePath, run: ScenarioRun) -> None:
    """Write a run to its file atomically."""
    path = run_path(folder, run.conditions)
    content = {
        "conditions": asdict(run.conditions),
        "planning": run.planning and asdict(run.planning),
        "scores": {name: values.tolist() for name, values in run.scores.items()},
        "samples": {
            str(sample.episode): {"tip_m": sample.tip.tolist(), "theta_rad": sample.theta.tolist()}
            for sample in run.samples
        },
    }
    write_text_atomic(path, json.dumps({HASH: file_hash(content, path.name), **content}, allow_nan=False) + "\n")


def file_hash(content: Mapping[str, object], name: str) -> str:
    """Return the SHA-256 of a file's name and everything in the file except the hash itself."""
    parts = [name, {key: part for key, part in content.items() if key != HASH}]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, allow_nan=False).encode()).hexdigest()


def read_run(path: FilePath) -> ScenarioRun:
    """Return the run in a file.

    Raises
    ------
    DataError
        If the file is damaged, made by other code, or not the one written under its name; it says why.
    """
    path = find_path("path", path)
    with reading(path.name):
        content = _content(path)
        at = _conditions(content["conditions"])
        expected = run_path(path.parents[1], at).name
        _require(expected == path.name, f"its name is not that of its run, which is {expected}")
        _require(at.code == code_digest(), other_score(at.code))
        if at.fresh is None:
            found = stored_checksum(at.scenario)
            _require(at.data == found, "it is of other episodes than those that are stored")
        strata = strata_of(at.scenario, at.pace, at.fresh_seed)
        _check_range("episodes", at.episodes, 1, len(strata))
        strata = strata[: at.episodes]
        return ScenarioRun(
            conditions=at,
            strata=strata,
            scores={name: _scores(content["scores"][name], name, at.episodes) for name in METRICS},
            samples=tuple(_sample(k, content["samples"][str(k)]) for k in sample_numbers(strata)),
            planning=None if content["planning"] is None else _planning(content["planning"]),
        )


def _content(path: Path) -> dict[str, Any]:
    """Return the content of a file if it is what was written."""
    data = read_bytes(path, MOST_JSON)
    try:
        content = parse_json(data)
    except ValueError as error:
        raise ValueError(f"it is not JSON: {error}") from None
    _require(content[HASH] == file_hash(content, path.name), "it was edited, copied or renamed: its SHA-256 is another")
    return content


def _conditions(content: Mapping[str, Any]) -> Conditions:
    _check_types(Conditions, content)
    at = Conditions(**content)
    check_name(at.policy)
    find_pace(at.pace)
    _check_range("seed", at.seed, 0)
    check_fresh(at.fresh)
    return at


def _planning(content: Mapping[str, Any]) -> Planning:
    _check_types(Planning, content)
    for name in ("rollouts", "horizon_s", "decision_ms"):
        _check_range(name, content[name], 0)
    return Planning(**content)


def _scores(content: Any, name: str, count: int) -> NDArray[Any]:
    values = _array(content, name, (count,), "b" if name == "completed" else "f")
    for value in (values.min(), values.max()):
        _check_range(name, value, METRICS[name].low, METRICS[name].high)
    return values


def _sample(episode: int, content: Mapping[str, Any]) -> Sample:
    instants = len(content["tip_m"])
    _check_range("instants of a sample", instants, 1, INSTANTS)
    return Sample(episode, *(_array(content[name], name, (instants, 2), "f") for name in ("tip_m", "theta_rad")))


def _array(content: Any, name: str, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    """Return an array of a shape and kind, ``f`` for numbers and ``b`` for booleans."""
    values = np.array(content)
    good = values.shape == shape and values.dtype.kind == kind
    what = "numbers" if kind == "f" else "true or false"
    _require(good, f"{name} must be {what} of the shape {shape}, got {shorten(repr(content)[:200], 60)}")
    return values


def _check_types(kind: type[Any], content: Mapping[str, Any]) -> None:
    """Raise an error unless an object holds a value of the right type for each field of a dataclass."""
    for item in fields(kind):
        accepted, value = item.type, content[item.name]
        good = isinstance(value, accepted) and (accepted is bool or not isinstance(value, bool))  # type: ignore[arg-type]
        _require(good, f"{item.name} must be {getattr(accepted, '__name__', accepted)}, got {value!r:.60}")


def _check_range(name: str, value: float, low: float | None, high: float | None = None) -> None:
    least, most = -math.inf if low is None else low, math.inf if high is None else high
    _require(least <= value <= most, f"{name} must be within [{least:g}, {most:g}], got {value!r}")


def _require(condition: object, complaint: str) -> None:
    if not condition:
        raise ValueError(complaint)
