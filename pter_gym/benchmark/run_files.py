"""The file of a run. Whoever reads one believes nothing: each part is checked, and a complaint says what is wrong.

A file holds a SHA-256 over its own name and all that is in it, so a part that is edited, and a file that is copied or
renamed, does not pass. Whoever computes the hash again has still scores that ``pter verify`` refutes.
"""

import hashlib
import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import shorten
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark.episodes import FOLDER, SEEDS, stored_strata
from pter_gym.benchmark.metrics import METRICS, Values
from pter_gym.benchmark.runs import (
    INSTANTS,
    Conditions,
    Planning,
    Sample,
    ScenarioRun,
    check_name,
    code_digest,
    sample_numbers,
)
from pter_gym.internal.files import FilePath, find_path, write_text_atomic
from pter_gym.internal.reading import MOST_JSON, parse_json, read_bytes, reading
from pter_gym.scenarios import find_pace

HASH = "sha256"
"""Name of the hash in a file."""

PARTS = (HASH, *Conditions.__dataclass_fields__, "strata", "planning", "scores", "samples")


def run_path(folder: FilePath, conditions: Conditions) -> Path:
    """Return the file of a run in a folder of results."""
    name = "-".join((conditions.scenario, conditions.pace, conditions.policy, str(conditions.episodes)))
    name += "" if conditions.fresh is None else f"-fresh{conditions.fresh}"
    name += f"-seed{conditions.seed}" if conditions.seed else ""
    return find_path("folder", folder) / "runs" / f"{quote(name, safe=' ')}.json"


def write_run(folder: FilePath, run: ScenarioRun) -> None:
    """Write a run to its file, whole or not at all."""
    path = run_path(folder, run.conditions)
    content = {
        **asdict(run.conditions),
        "strata": run.strata,
        "planning": run.planning and asdict(run.planning),
        "scores": {name: values.tolist() for name, values in run.scores.items()},
        "samples": [
            {"episode": sample.episode, "tip_m": sample.tip.tolist(), "theta_rad": sample.theta.tolist()}
            for sample in run.samples
        ],
    }
    sealed = {HASH: file_hash(content, path.name), **content}
    write_text_atomic(path, json.dumps(sealed, allow_nan=False) + "\n")


def file_hash(content: Mapping[str, object], name: str) -> str:
    """Return the SHA-256 of a file's name and all that is in the file but the hash itself."""
    parts = [name, {key: part for key, part in content.items() if key != HASH}]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, allow_nan=False).encode()).hexdigest()


def read_run(path: FilePath, *, data: FilePath = FOLDER) -> ScenarioRun:
    """Return the run in a file.

    Parameters
    ----------
    path
        Of the file.
    data
        Folder of the stored episodes.

    Raises
    ------
    DataError
        If the file is not whole, or of other code, or not what was written under its name; it says why.
    """
    path = find_path("path", path)
    with reading(path.name):
        content = _content(path)
        conditions = _conditions(content)
        if run_path(path.parents[1], conditions).name != path.name:
            raise ValueError(f"its name is not that of its run, which is {run_path(Path(), conditions).name}")
        if conditions.code != code_digest():
            raise ValueError(f"it is of other code, version {conditions.version}")
        checksum, strata = stored_strata(conditions.scenario, folder=data)  # fresh episodes have the same strata
        if conditions.fresh is None and conditions.data != checksum:
            raise ValueError("it is of other episodes than those that are stored")
        _whole(conditions.episodes, "episodes", 1, len(strata))
        strata = strata[: conditions.episodes]
        if content["strata"] != list(strata):
            raise ValueError("strata are not those of the episodes")
        return ScenarioRun(
            conditions,
            strata,
            _scores(content["scores"], len(strata)),
            _samples(content["samples"], strata),
            _planning(content["planning"]),
        )


def _content(path: Path) -> dict[str, Any]:
    """Return what a file holds, if that is what was written to it."""
    data = read_bytes(path, MOST_JSON)
    try:
        content = parse_json(data)
    except ValueError as error:
        raise ValueError(f"it is no JSON: {error}") from None
    _check_keys(content, PARTS, "it")
    if content[HASH] != file_hash(content, path.name):
        raise ValueError("it was edited, copied or renamed: its SHA-256 is another")
    return content


def _conditions(content: Mapping[str, Any]) -> Conditions:
    """Return the conditions of a file, each of the type and in the range that it must have."""
    for name in ("scenario", "pace", "policy", "data", "version", "code"):
        _require(type(content[name]) is str, name, "a text", content[name])
    _require(type(content["identity"]) in (str, type(None)), "identity", "a text or null", content["identity"])
    _whole(content["seed"], "seed", 0)
    _whole(content["episodes"], "episodes", 1)
    if content["fresh"] is not None:
        _whole(content["fresh"], "fresh", 0, SEEDS - 1)
    check_name(content["policy"])
    find_pace(content["pace"])
    return Conditions(**{name: content[name] for name in Conditions.__dataclass_fields__})


def _planning(content: Any) -> Planning | None:
    if content is None:
        return None
    _check_keys(content, Planning.__dataclass_fields__, "planning")
    _require(type(content["privileged"]) is bool, "privileged", "true or false", content["privileged"])
    _whole(content["rollouts"], "rollouts", 0)
    for name in ("horizon_s", "decision_ms"):
        _numbers([content[name]], name, (1,), 0.0)
    return Planning(**content)


def _scores(content: Any, count: int) -> dict[str, Values]:
    _check_keys(content, METRICS, "scores")
    found = {name: _numbers(content[name], name, (count,), metric.low, metric.high) for name, metric in METRICS.items()}
    _require(set(found["completed"].tolist()) <= {0.0, 1.0}, "completed", "true or false", content["completed"])
    return {**found, "completed": found["completed"] == 1.0}


def _samples(content: Any, strata: Sequence[str]) -> tuple[Sample, ...]:
    _require(isinstance(content, list), "samples", "a list", content)
    for sample in content:
        _check_keys(sample, ("episode", "tip_m", "theta_rad"), "a sample")
        _require(isinstance(sample["tip_m"], list), "tip_m", "a list", sample["tip_m"])
    numbers = [sample["episode"] for sample in content]
    _require(numbers == sample_numbers(strata), "samples", f"those of the episodes {sample_numbers(strata)}", numbers)
    return tuple(_sample(sample) for sample in content)


def _sample(content: Mapping[str, Any]) -> Sample:
    instants = len(content["tip_m"])
    _require(1 <= instants <= INSTANTS, "tip_m", f"a list of 1 to {INSTANTS} points", content["tip_m"])
    tip, theta = (_numbers(content[name], name, (instants, 2)) for name in ("tip_m", "theta_rad"))
    return Sample(content["episode"], tip, theta)


def _numbers(
    content: Any, name: str, shape: tuple[int, ...], low: float | None = None, high: float | None = None
) -> NDArray[np.float64]:
    """Return finite numbers of a shape within a range."""
    try:
        values = np.array(content)
    except ValueError:  # lists of different lengths
        values = np.empty(0)
    _require(values.shape == shape and values.dtype.kind in "bif", name, f"numbers of the shape {shape}", content)
    values = values.astype(np.float64)
    least, most = -math.inf if low is None else low, math.inf if high is None else high
    good = np.isfinite(values) & (values >= least) & (values <= most)
    _require(good.all(), name, f"finite numbers from {least:g} to {most:g}", values[~good][:1].tolist())
    return values


def _whole(value: Any, name: str, low: int, high: float = math.inf) -> None:
    _require(type(value) is int and low <= value <= high, name, f"a whole number from {low} to {high:g}", value)


def _check_keys(content: Any, names: Collection[str], what: str) -> None:
    _require(isinstance(content, dict), what, "an object", content)
    missing = [name for name in names if name not in content]
    unknown = [name for name in content if name not in names]
    for told, differ in (("is missing", missing), ("is unknown", unknown)):
        if differ:
            raise ValueError(f"{what}: {differ[0]!r} {told}")


def _require(condition: object, name: str, accepted: str, found: Any) -> None:
    if not condition:
        raise ValueError(f"{name} must be {accepted}, got {shorten(repr(found)[:200], 60)}")
