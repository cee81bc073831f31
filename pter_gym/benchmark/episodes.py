"""The evaluation episodes: stored ones, which everybody can see, and fresh ones, drawn from a seed.

``pter_gym/episodes`` holds one file of stored episodes for each scenario and one with their checksums. Only
``docs/make/store.py episodes`` writes them.
"""

import gzip
import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from numbers import Integral
from pathlib import Path
from typing import Any

from pter_gym import hands, params, paths
from pter_gym._internal.checks import whole_number
from pter_gym._internal.codec import Codec, dataclasses_in
from pter_gym._internal.files import FilePath, find_path, write_bytes_atomic, write_text_atomic
from pter_gym._internal.reading import MOST_JSON, inflate, parse_json, read_bytes, reading
from pter_gym.errors import DataError, ParameterError, unknown_name
from pter_gym.params import Machine
from pter_gym.scenarios import find_pace, find_scenario
from pter_gym.scenarios._evaluation_draws import evaluation_draws, fresh_reset_seeds
from pter_gym.tasks import path_following
from pter_gym.tasks.path_following import PathFollowing

FOLDER = Path(__file__).parents[1] / "episodes"
"""Where the package keeps its evaluation episodes."""

CHECKSUMS = "checksums.json"

MAX_SEED = 2**64
"""Seeds of fresh episodes are smaller."""

_OPERATING_SYSTEM, _UNIX = 9, 3
"""Place of a byte in the header of gzip, and its value in the shipped files (RFC 1952)."""

CODEC = Codec(dataclasses_in(params, hands, paths, path_following))
"""Knows the parts of machines and tasks."""


@dataclass(frozen=True)
class Episodes:
    """Evaluation episodes, one entry each.

    Attributes
    ----------
    scenario
        Name of the scenario.
    machines, tasks
        What to simulate; the tasks command the requested pace.
    seeds
        Seeds of the resets.
    strata
        Labels of the strata within which the bootstrap resamples episodes.
    """

    scenario: str
    machines: tuple[Machine, ...]
    tasks: tuple[PathFollowing, ...]
    seeds: tuple[int, ...]
    strata: tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of episodes."""
        return len(self.seeds)

    def first(self, count: int) -> "Episodes":
        """Return the first ``count`` episodes, or raise a ParameterError if there are fewer."""
        if not isinstance(count, Integral) or not 1 <= count <= len(self):
            raise ParameterError(f"episodes must be from 1 to {len(self)} for {self.scenario}, got {count!r}")
        parts = ("machines", "tasks", "seeds", "strata")
        return replace(self, **{name: getattr(self, name)[:count] for name in parts})

    def at_pace(self, speed: float) -> "Episodes":
        """Return the episodes at a commanded pace [m/s]; tasks that are the same object stay so."""
        paced = {id(task): replace(task, pace=speed) for task in self.tasks}
        return replace(self, tasks=tuple(paced[id(task)] for task in self.tasks))


def scenarios(folder: FilePath = FOLDER) -> tuple[str, ...]:
    """Return the names of the scenarios that have stored episodes."""
    return tuple(sorted(_checksums(find_path("folder", folder))))


def load_episodes(scenario: str, pace: str, *, folder: FilePath = FOLDER) -> Episodes:
    """Return the stored evaluation episodes of a scenario at a pace, or raise a DataError if they were changed."""
    speed = find_pace(pace)
    return _stored(scenario, folder).at_pace(speed)


def find_episodes(scenario: str, pace: str, seed: int | None = None) -> Episodes:
    """Return a scenario's stored evaluation episodes at a pace, or fresh ones from a seed within [0, 2⁶⁴).

    There are as many fresh episodes as stored ones in each stratum, in an order given by the seed; each pace has its
    own draws. Raises as ``load_episodes``, and a ParameterError if the seed is out of range.
    """
    if seed is None:
        return load_episodes(scenario, pace)
    speed = find_pace(pace)
    find_scenario(scenario)
    if whole_number("seed", seed, at_least=0) >= MAX_SEED:
        raise ParameterError(f"seed must be a whole number within [0, 2⁶⁴), got {seed!r}")
    return _draw(scenario, int(seed), pace).at_pace(speed)


def store_episodes(
    scenario: str,
    machines: Sequence[Machine],
    tasks: Sequence[PathFollowing],
    seeds: Sequence[int],
    strata: Sequence[str],
    *,
    version: int,
    folder: FilePath = FOLDER,
) -> Path:
    """Write the evaluation episodes of a scenario and their checksum; the same episodes give the same bytes.

    Parameters are as in ``Episodes``, with the version of the scenario and the folder, created if needed.
    """
    folder = find_path("folder", folder)
    folder.mkdir(parents=True, exist_ok=True)
    draws = zip(machines, tasks, seeds, strata, strict=True)
    data = bytearray(gzip.compress(_encode(scenario, version, draws), mtime=0))
    data[_OPERATING_SYSTEM] = _UNIX  # versions of Python name it differently
    sums = _checksums(folder) if (folder / CHECKSUMS).exists() else {}
    path = folder / f"{scenario}.json.gz"
    write_bytes_atomic(path, bytes(data))
    sums[scenario] = hashlib.sha256(data).hexdigest()
    write_text_atomic(folder / CHECKSUMS, json.dumps(dict(sorted(sums.items())), indent=2) + "\n")
    return path


@lru_cache(8)
def _draw(scenario: str, seed: int, pace: str) -> Episodes:
    found = find_scenario(scenario)
    machines, tasks, strata = zip(*evaluation_draws(found, (seed, pace)), strict=True)
    return Episodes(scenario, machines, tasks, tuple(fresh_reset_seeds(found, (seed, pace))), strata)


def _encode(scenario: str, version: int, draws: Iterable[tuple[Machine, PathFollowing, int, str]]) -> bytes:
    """Return the JSON of a file of episodes, in which equal machines and tasks are stored once."""
    parts: dict[str, int] = {}

    def number(part: object) -> int:
        return parts.setdefault(json.dumps(CODEC.to_plain(part), sort_keys=True, ensure_ascii=False), len(parts))

    entries = [
        {"machine": number(machine), "task": number(task), "seed": seed, "stratum": stratum}
        for machine, task, seed, stratum in draws
    ]
    plain = [json.loads(part) for part in parts]
    content = {"scenario": scenario, "version": version, "parts": plain, "episodes": entries}
    return json.dumps(content, ensure_ascii=False, allow_nan=False).encode()


def _checksums(folder: Path) -> dict[str, str]:
    with reading(f"evaluation data {folder / CHECKSUMS} cannot be read"):
        return dict(parse_json(read_bytes(folder / CHECKSUMS, MOST_JSON)))


def _stored(scenario: str, folder: FilePath) -> Episodes:
    folder = find_path("folder", folder)
    sums, path = _checksums(folder), folder / f"{scenario}.json.gz"
    if scenario not in sums:
        raise unknown_name("scenario", scenario, sorted(sums))
    with reading(f"evaluation data {path} cannot be read"):
        data = read_bytes(path, MOST_JSON)
    found = hashlib.sha256(data).hexdigest()
    if found != sums[scenario]:
        raise DataError(f"evaluation data {path} were changed: SHA-256 is {found}, stored was {sums[scenario]}")
    with reading(f"evaluation data {path}"):
        return _decode(data)


@lru_cache(16)
def _decode(data: bytes) -> Episodes:
    content: dict[str, Any] = parse_json(inflate(data, MOST_JSON))
    parts: list[Any] = [CODEC.from_plain(part) for part in content["parts"]]
    entries: list[dict[str, Any]] = content["episodes"]
    return Episodes(
        content["scenario"],
        machines=tuple(parts[entry["machine"]] for entry in entries),
        tasks=tuple(parts[entry["task"]] for entry in entries),
        seeds=tuple(entry["seed"] for entry in entries),
        strata=tuple(entry["stratum"] for entry in entries),
    )
