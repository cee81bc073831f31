"""Episodes to run policies on: test episodes, stored or drawn from a seed, and training episodes.

``pter_gym/episodes`` holds a file of stored episodes for each scenario; ``docs/make/store.py
episodes`` writes them.
"""

import gzip
import json
import math
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from pter_gym._engine.batch import Batch
from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, expand_path, write_bytes_atomic
from pter_gym._internal.reading import MAX_JSON_SIZE, inflate, parse_json, read_bytes, reading
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.hands import HandSpread, Operator
from pter_gym.params import BASELINE, Machine
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.scenarios._evaluation_draws import evaluation_draws, fresh_reset_seeds
from pter_gym.scenarios.distributions import Draws, Pair
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks._codec import codec
from pter_gym.tasks.path_following import PathFollowing, Sensors

FOLDER = Path(__file__).parents[1] / "episodes"
"""Where the package keeps its test episodes."""

EPISODE_FIELDS = ("machines", "tasks", "seeds", "strata", "time_limits")
"""Fields of ``Episodes`` that have an entry for each episode."""

EPISODES_ENDING = ".json.gz"

CHUNK = 128
"""Most episodes that are simulated together."""

LONGEST = 20_000
"""Most control steps of an episode: 200 s at 100 Hz."""

MAX_SEED = 2**64 - 1
"""Largest seed of test episodes."""


@dataclass(frozen=True)
class Episodes:
    """Episodes, one entry each: machines, tasks that command a pace, and seeds of the resets.

    Attributes
    ----------
    scenario
        Name of the scenario.
    machines, tasks, seeds
        What makes an episode.
    strata
        Labels of the strata within which episodes are resampled.
    nominal
        The machine that policies know.
    time_limits
        Control steps after which an episode ends; by default ``time_limit`` of its task.
    """

    scenario: str
    machines: tuple[Machine, ...]
    tasks: tuple[PathFollowing, ...]
    seeds: tuple[int, ...]
    strata: tuple[str, ...]
    nominal: Machine = BASELINE
    time_limits: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Set the time limits that are not given."""
        if not self.time_limits:
            object.__setattr__(self, "time_limits", tuple(map(time_limit, self.tasks)))

    @classmethod
    def from_pairs(
        cls,
        scenario: str,
        draws: Draws,
        pairs: Iterable[Pair],
        seeds: Iterable[int],
        strata: Iterable[str] = (),
    ) -> Self:
        """Return episodes of pairs; policies know the machine in the middle of ``draws``."""
        machines, tasks = zip(*pairs, strict=True)
        strata = tuple(strata) or ("",) * len(tasks)
        return cls(scenario, machines, tasks, tuple(seeds), strata, draws.middle)

    def __len__(self) -> int:
        """Return the number of episodes."""
        return len(self.seeds)

    def __getitem__(self, part: slice) -> "Episodes":
        """Return some of the episodes."""
        return replace(self, **{name: getattr(self, name)[part] for name in EPISODE_FIELDS})

    @cached_property
    def chunks(self) -> "tuple[Episodes, ...]":
        """The episodes in chunks of about equal size, each simulated together."""
        count = -(-len(self) // CHUNK)
        ends = [len(self) * k // count for k in range(count + 1)]
        return tuple(self[begin:end] for begin, end in pairwise(ends))

    @contextmanager
    def worlds(self, sensors: Sensors) -> Generator[Batch]:
        """Lend a batch with a world for each episode, which later rollouts use again."""
        idle = self._idle.setdefault(sensors, [])
        try:
            batch = idle.pop()
        except IndexError:
            batch = Batch(self.machines, self.tasks, sensors=sensors)
        yield batch
        idle.append(batch)

    @cached_property
    def _idle(self) -> dict[str, list[Batch]]:
        return {}

    def first(self, count: int) -> "Episodes":
        """Return the first ``count`` episodes, or raise a ParameterError if there are fewer."""
        if whole_number("episodes", count) > len(self):
            raise ParameterError(
                f"episodes must be from 1 to {len(self)} for {self.scenario}, got {count!r}"
            )
        return self[:count]

    def at_pace(self, speed: float) -> "Episodes":
        """Return the episodes at a commanded pace [m/s]; tasks that are the same object stay so."""
        return self.with_task(pace=speed)

    def with_task(self, **values: Any) -> "Episodes":
        """Return the episodes with other values in fields of all tasks, as ``at_pace``."""
        changed = {id(task): replace(task, **values) for task in self.tasks}
        return replace(self, tasks=tuple(changed[id(task)] for task in self.tasks), time_limits=())


def time_limit(task: PathFollowing) -> int:
    """Return the control steps of an episode: three times its time at the pace, at least 300.

    Raises a ParameterError if they are more than ``LONGEST``.
    """
    metres, most = 3.0 * task.path.length, LONGEST * task.control_period
    if metres > most * task.pace:
        raise ParameterError(
            f"pace must be at least {metres / most:.3g} m/s on a path of {task.path.length:.4g} m, "
            f"where an episode then lasts {most:g} s, got {task.pace!r}"
        )
    return max(300, math.ceil(metres / (task.pace * task.control_period)))


def scenarios(folder: FilePath = FOLDER) -> tuple[str, ...]:
    """Return the names of the scenarios that have stored episodes."""
    return tuple(
        sorted(
            path.name.removesuffix(EPISODES_ENDING)
            for path in expand_path("folder", folder).glob(f"*{EPISODES_ENDING}")
        )
    )


def load_episodes(scenario: str, pace: str, *, folder: FilePath = FOLDER) -> Episodes:
    """Return the test episodes of a scenario at a pace.

    Raises
    ------
    ParameterError
        If there is no such pace, or no episodes of such a scenario.
    DataError
        If the file is damaged.
    """
    speed, path = find_pace(pace), expand_path("folder", folder) / f"{scenario}{EPISODES_ENDING}"
    if scenario not in (names := scenarios(folder)):
        raise unknown_name("scenario", scenario, names)
    with reading(f"evaluation data {path}"):
        content = _decode(read_bytes(path, MAX_JSON_SIZE))
    return content.at_pace(speed)


def find_episodes(
    scenario: str | Scenario,
    pace: str,
    seed: int | None = None,
    machine: Machine | str | None = None,
    hand: Operator | HandSpread | str | None = None,
) -> Episodes:
    """Return a scenario's test episodes at a pace, stored or drawn from a seed.

    A seed gives as many as are stored in each stratum, in an order of its own; each pace has its
    own draws. Draws of one's own, and a machine or a hand in place of those that would be drawn,
    are not stored: without a seed, the episodes are then drawn as the stored ones were. Raises as
    ``load_episodes``, and a ParameterError if the seed is out of range.
    """
    scenario = find_scenario(scenario, machine, hand=hand)
    if seed is not None and whole_number("seed", seed, at_least=0) > MAX_SEED:
        raise ParameterError(f"seed must be a whole number within [0, 2⁶⁴), got {seed!r}")
    if seed is None and scenario.own is None:
        return replace(load_episodes(scenario.name, pace), nominal=scenario.nominal)
    return draw_episodes(scenario, None if seed is None else (int(seed), pace)).at_pace(
        find_pace(pace)
    )


def training_episodes(
    scenario: str | Scenario | PathFollowing,
    pace: str,
    episodes: int,
    seed: int,
    machine: Machine | str | None = None,
) -> Episodes:
    """Return training episodes of a scenario at a pace, the shortest episodes first.

    ``seed`` selects the episodes, and ``machine`` replaces their machines.
    """
    scenario = find_scenario(scenario, machine)
    # those of a chunk end at about one time
    pairs = sorted(scenario.draws.pairs(episodes, seed, pace), key=lambda pair: time_limit(pair[1]))
    seeds = range(seed * len(pairs), (seed + 1) * len(pairs))
    return Episodes.from_pairs(scenario.name, scenario.draws, pairs, seeds)


def store_episodes(episodes: Episodes, *, version: int, folder: FilePath = FOLDER) -> Path:
    """Write the test episodes of a scenario to a folder, and return the path of the file.

    Equal machines and tasks are stored once, and the same episodes give the same bytes. ``version``
    is the scenario's.
    """
    parts: dict[str, int] = {}

    def number(part: object) -> int:
        return parts.setdefault(
            json.dumps(codec().to_plain(part), sort_keys=True, ensure_ascii=False), len(parts)
        )

    draws = zip(episodes.machines, episodes.tasks, episodes.seeds, episodes.strata, strict=True)
    entries = [
        {"machine": number(machine), "task": number(task), "seed": seed, "stratum": stratum}
        for machine, task, seed, stratum in draws
    ]
    plain = [json.loads(part) for part in parts]
    content = {
        "scenario": episodes.scenario,
        "version": version,
        "parts": plain,
        "episodes": entries,
    }
    data = json.dumps(content, ensure_ascii=False, allow_nan=False).encode()
    path = expand_path("folder", folder) / f"{episodes.scenario}{EPISODES_ENDING}"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(path, gzip.compress(data, 9, mtime=0))
    return path


@lru_cache(8)
def draw_episodes(scenario: Scenario, fresh: tuple[int, str] | None = None) -> Episodes:
    """Return test episodes, drawn as ``evaluation_draws`` has it."""
    draws = evaluation_draws(scenario, fresh)
    seeds = range(len(draws)) if fresh is None else fresh_reset_seeds(scenario, fresh)
    pairs, strata = [draw[:2] for draw in draws], [draw[2] for draw in draws]
    return Episodes.from_pairs(scenario.name, scenario.draws, pairs, seeds, strata)


@lru_cache(16)
def _decode(data: bytes) -> Episodes:
    content: dict[str, Any] = parse_json(inflate(data, MAX_JSON_SIZE))
    parts: list[Any] = [codec().from_plain(part) for part in content["parts"]]
    entries: Sequence[dict[str, Any]] = content["episodes"]
    return Episodes(
        content["scenario"],
        machines=tuple(parts[entry["machine"]] for entry in entries),
        tasks=tuple(parts[entry["task"]] for entry in entries),
        seeds=tuple(entry["seed"] for entry in entries),
        strata=tuple(entry["stratum"] for entry in entries),
    )
