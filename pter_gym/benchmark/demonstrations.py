"""Episodes of named policies on training draws, as one file: what they saw, what they did, and their scores.

The file is a NumPy archive without pickles. ``read_demonstrations`` checks sizes, names, types and numbers before
anybody uses them. Observations are those with force sensors, whose first entries are those with fewer sensors.
"""

import io
import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._version import __version__
from pter_gym.benchmark.metrics import SCORES, Score, score
from pter_gym.benchmark.naming import find_policy
from pter_gym.benchmark.simulation import record_episode, time_limit
from pter_gym.errors import ParameterError
from pter_gym.internal.archives import read_arrays
from pter_gym.internal.checks import whole_number
from pter_gym.internal.files import FilePath, find_path, write_bytes_atomic
from pter_gym.internal.reading import parse_json, read_bytes, reading
from pter_gym.params import BASELINE
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import observation_layout

ENTRIES = observation_layout(BASELINE, "force").names
"""Names of the entries of an observation; a file has those that there were when it was written."""

NAMES = ("policy", "scenario", "pace")
"""What each episode is called by."""

ROWS = ("obs", "volts")
"""Arrays with one row for each decision."""

MOST_FILE, MOST_UNPACKED = 1 << 26, 1 << 27
"""Largest file, and largest content of it [B]."""


@dataclass(frozen=True)
class Demonstrations:
    """Episodes of policies; N decisions in E episodes.

    Attributes
    ----------
    obs
        What was seen, float32 (N, entries), each entry relative to its scale; ``info["entries"]`` names them.
    volts
        What was decided then [V], float32 (N, 4).
    starts, ends
        An episode has the rows from its start to before its end, int64 (E,).
    policies, scenarios, paces
        Names, one for each episode.
    draws
        Numbers of the training draws, int64 (E,); policies have the same draws.
    scores
        The fields of ``Score`` by name, (E,) each.
    info
        The command that made them, the versions, the names of the entries.
    """

    obs: NDArray[np.float32]
    volts: NDArray[np.float32]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    policies: tuple[str, ...]
    scenarios: tuple[str, ...]
    paces: tuple[str, ...]
    draws: NDArray[np.int64]
    scores: dict[str, NDArray[Any]]
    info: dict[str, Any]

    def __len__(self) -> int:
        """Return the number of episodes."""
        return len(self.starts)


def record(
    policies: Sequence[str],
    scenarios: Sequence[str],
    paces: Sequence[str],
    *,
    episodes: int,
    seed: int = 0,
    on_episode: Callable[[], None] = lambda: None,
) -> Demonstrations:
    """Simulate policies on training draws; the stored evaluation episodes are never read.

    Parameters
    ----------
    policies, scenarios, paces
        Names, as in ``pter benchmark``.
    episodes
        Training draws for each scenario and pace, at least 1; all policies have the same.
    seed
        Of the draws, at least 0.
    on_episode
        Called after each episode.

    Raises
    ------
    ParameterError
        If a name is unknown or missing, or a number is out of range.
    """
    for field, given in (("policies", policies), ("scenarios", scenarios), ("paces", paces)):
        if not given:
            raise ParameterError(f"{field} must hold at least one name")
    episodes, seed = whole_number("episodes", episodes), whole_number("seed", seed, at_least=0)
    named = [(name, scenario, find_policy(name, scenario=scenario)) for scenario in scenarios for name in policies]
    drawn = {
        (scenario, pace): find_scenario(scenario).randomisation(pace, contexts=episodes, seed=seed).pairs()
        for scenario in scenarios
        for pace in paces
    }
    kept: list[_Recorded] = []
    for name, scenario, policy in named:
        for pace in paces:
            for k, (machine, task) in enumerate(drawn[scenario, pace]):
                episode = record_episode(policy, machine, task, seed * episodes + k, time_limit(task))
                found = score(episode.telemetry, task, voltage_max=machine.clutch.voltage_max)
                kept.append(_Recorded((name, scenario, pace), k, episode.obs[:-1], episode.volts, found))
                on_episode()
    command = (
        f"pter record --policies {','.join(policies)} --scenarios {','.join(scenarios)} "
        f"--paces {','.join(paces)} --episodes {episodes} --seed {seed}"
    )
    return _stacked(kept, command)


class _Recorded(NamedTuple):
    """One episode: what it is called, the number of its draw, what was seen and decided, and its score."""

    names: tuple[str, str, str]
    draw: int
    obs: NDArray[np.float32]
    volts: NDArray[np.float32]
    score: Score


def _stacked(kept: Sequence[_Recorded], command: str) -> Demonstrations:
    """Return episodes behind each other, as the command made them."""
    ends = np.cumsum([len(episode.volts) for episode in kept])
    policies, scenarios, paces = zip(*(episode.names for episode in kept), strict=True)
    return Demonstrations(
        obs=np.concatenate([episode.obs for episode in kept]),
        volts=np.concatenate([episode.volts for episode in kept]),
        starts=np.concatenate([[0], ends[:-1]]).astype(np.int64),
        ends=ends.astype(np.int64),
        policies=policies,
        scenarios=scenarios,
        paces=paces,
        draws=np.array([episode.draw for episode in kept], np.int64),
        scores={name: np.array([getattr(episode.score, name) for episode in kept]) for name in SCORES},
        info={
            "command": command,
            "version": __version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
            "entries": list(ENTRIES),
        },
    )


def write_demonstrations(found: Demonstrations, path: FilePath) -> None:
    """Write demonstrations to a file, whole or not at all; its folder must exist."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {
        **{name: getattr(found, name) for name in (*ROWS, "starts", "ends", "draws")},
        **{name: np.array(getattr(found, _plural(name))) for name in NAMES},
        **{f"score_{name}": values for name, values in found.scores.items()},
        "info": np.array(json.dumps(found.info)),
    }
    np.savez_compressed(buffer, **arrays)
    write_bytes_atomic(path, buffer.getvalue())


def read_demonstrations(path: FilePath) -> Demonstrations:
    """Return the demonstrations in a file.

    Raises
    ------
    ParameterError
        If it is no path.
    DataError
        If the file is missing, too large, or not what ``write_demonstrations`` wrote; nothing in it was executed.
    """
    path = find_path("path", path)
    expected = {*ROWS, "starts", "ends", "draws", *NAMES, *(f"score_{name}" for name in SCORES), "info"}
    with reading(f"demonstrations {path} are refused"):
        arrays = read_arrays(read_bytes(path, MOST_FILE), MOST_UNPACKED, expected)
        info = parse_json(str(arrays.pop("info")).encode())
        scores = {name: arrays.pop(f"score_{name}") for name in SCORES}
        names: dict[str, Any] = {_plural(name): _names(arrays.pop(name), name) for name in NAMES}
        found = Demonstrations(**cast("dict[str, Any]", arrays), **names, scores=scores, info=info)
        _check(found)
        return found


def _names(array: NDArray[Any], name: str) -> tuple[str, ...]:
    if array.dtype.kind != "U" or array.ndim != 1:
        raise ValueError(f"{name} must hold names")
    return tuple(array.tolist())


def _plural(name: str) -> str:
    return "policies" if name == "policy" else f"{name}s"


def _check(found: Demonstrations) -> None:
    """Raise a ValueError unless rows, episodes, names and scores go together."""
    rows, episodes = len(found.obs), len(found)
    info: Any = found.info
    entries: Any = cast("dict[str, Any]", info).get("entries") if isinstance(info, dict) else None
    if not entries or entries != [name for name in ENTRIES if name in entries]:
        raise ValueError("info must name the entries of the observation")
    for name, width in zip(ROWS, (len(entries), 4), strict=True):
        array = getattr(found, name)
        if array.dtype != np.float32 or array.shape != (rows, width) or not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite numbers of float32 with the shape ({rows}, {width})")
    for name in ("starts", "ends", "draws"):
        array = getattr(found, name)
        if array.dtype != np.int64 or array.shape != (episodes,):
            raise ValueError(f"{name} must be int64 with the shape ({episodes},)")
    follows = np.array_equal(found.starts, np.concatenate([[0], found.ends[:-1]])) and (found.ends > found.starts).all()
    if episodes == 0 or not follows or found.ends[-1] != rows:
        raise ValueError("episodes must follow each other without gaps, from the first row to the last")
    if any(len(getattr(found, _plural(name))) != episodes for name in NAMES):
        raise ValueError(f"there must be {episodes} names of each kind")
    for name, values in found.scores.items():
        if values.shape != (episodes,) or values.dtype.kind not in "bf" or not np.isfinite(values).all():
            raise ValueError(f"score_{name} must be {episodes} finite numbers")
