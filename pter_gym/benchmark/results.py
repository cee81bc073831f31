"""Run scenarios, and store the runs: a JSON file for each, and ``benchmark.json``, their boards.

Episodes themselves can be written as a table in a CSV file.
"""

import csv
import io
import json
import logging
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import lru_cache
from hashlib import sha256
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.checks import is_finite, whole_number
from pter_gym._internal.files import (
    FilePath,
    expand_path,
    has_ending,
    make_folder,
    write_text_atomic,
)
from pter_gym._internal.locks import LOCK, locked
from pter_gym._internal.reading import MAX_JSON_SIZE, parse_json, read_bytes, reading
from pter_gym._version import __version__
from pter_gym.benchmark.boards import PATH_ERROR, Leaderboard, leaderboards
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.faults import faults as faults_of
from pter_gym.benchmark.policies import Policies, find_policies
from pter_gym.benchmark.rollout import bind_to, check_acting, evaluate
from pter_gym.benchmark.scores import OPTIONAL, POLICY, SCORES, ScenarioRun, WorstHand
from pter_gym.benchmark.worst_hand import find_worst
from pter_gym.controllers import AnyPolicy
from pter_gym.errors import DataError, ParameterError
from pter_gym.params import Machine
from pter_gym.policies._code import code_digest
from pter_gym.scenarios import PACES, Scenario, find_scenario
from pter_gym.scenarios.paces import name_of_pace, names_of_paces
from pter_gym.tasks._codec import codec
from pter_gym.tasks.path_following import TELEMETRY, Failure, PathFollowing

RUN_ENTRIES = ("version", "scenario", "digest", "pace", "policy", "training_seed", "seed")
"""What a file says about a run, beside its numbers."""


WORST, ORIGIN, FAILURES = "worst_hand", "origin", "failures"
"""What it says beside them: the worst hand, where one was searched, what made the run, and what
fails in it."""

PACKAGES = ("numba", "numpy", "scipy")
"""Whose versions a run names."""


class ResultsFolder:
    """The folder of results at ``path``; ``summary`` is the file with all leaderboards.

    Files are written atomically, by one benchmark at a time, so several may share the folder.
    """

    def __init__(self, path: FilePath) -> None:
        self.path = expand_path("path", path)
        self.summary = self.path / "benchmark.json"

    def make(self) -> None:
        """Make the folder if needed; raise a ParameterError if it is not writable or has links."""
        for path in (*self.path.glob("*"), *self.path.glob("runs/*")):
            if path.is_symlink():
                raise ParameterError(
                    f"results must be in a folder without symbolic links, {str(path)!r} is one"
                )
        make_folder(self.path / "runs")

    def add(self, runs: Sequence[ScenarioRun]) -> None:
        """Store the runs of all training seeds of a policy at a pace, replacing earlier ones."""
        number = len(runs)
        with locked(self.path / LOCK):
            for run in runs:
                write_run(self.path, run)
            while (path := run_path(self.path, replace(runs[0], training_seed=number))).is_file():
                path.unlink(missing_ok=True)
                number += 1

    def runs(self) -> list[ScenarioRun]:
        """Return all runs; leave out files that cannot be read, with a warning of ``pter_gym``."""
        runs: list[ScenarioRun] = []
        for path in sorted((self.path / "runs").glob("*.json")):
            try:
                runs.append(read_run(path))
            except DataError as error:
                logging.getLogger("pter_gym").warning("left out %s", error)
        return runs

    def worst_hand(self, policy: str, scenario: Scenario, pace: str | float) -> WorstHand:
        """Return the worst hand for a policy; raise a ParameterError if none is stored."""
        which = (policy, scenario.name, scenario.digest, name_of_pace(pace), __version__)
        names = ("policy", "scenario", "digest", "pace", "version")
        runs = (run for run in self.runs() if tuple(getattr(run, name) for name in names) == which)
        found = [run.worst for run in runs if run.worst]
        if not found:
            raise ParameterError(
                f"worst must be a folder of `pter benchmark --worst` of version {__version__} with "
                f"{policy} on {scenario.name} at the pace {which[3]}, {str(self.path)!r} has none"
            )
        return max(found, key=PATH_ERROR)

    def summarise(self) -> tuple[Leaderboard, ...]:
        """Write ``benchmark.json`` from all runs in the folder and return its leaderboards."""
        self.make()
        with locked(self.path / LOCK):
            boards = leaderboards(self.runs())
            content = {"leaderboards": [board.as_json() for board in boards]}
            write_text_atomic(self.summary, json.dumps(content, indent=2, allow_nan=False) + "\n")
        return boards


def run_path(folder: FilePath, run: ScenarioRun) -> Path:
    """Return the file of a run in a folder of results."""
    fresh = "" if run.seed is None else f"-seed{run.seed}"
    trained = f"-training{run.training_seed}" if run.training_seed else ""
    own = f"-{run.digest}" if run.digest else ""
    name = f"{run.scenario}-{run.pace}-{run.policy}-{run.episodes}{fresh}{trained}{own}"
    return expand_path("folder", folder) / "runs" / f"{quote(name, safe=' ')}.json"


def write_run(folder: FilePath, run: ScenarioRun) -> None:
    """Write a run to its file atomically, a line for each entry and each score."""
    content: dict[str, Any] = {
        **{name: getattr(run, name) for name in RUN_ENTRIES},
        "episodes": run.episodes,
        ORIGIN: dict(run.origin),
        "strata": run.strata,
        **{name: run.scores[name].tolist() for name in SCORES if name in run.scores},
    }
    if run.failures:
        content[FAILURES] = [codec().to_plain(each) for each in run.failures]
    if run.worst:
        content[WORST] = {name: codec().to_plain(part) for name, part in vars(run.worst).items()}
    lines = (
        f"{json.dumps(name)}: {json.dumps(part, allow_nan=False)}" for name, part in content.items()
    )
    write_text_atomic(run_path(folder, run), "{\n" + ",\n".join(lines) + "\n}\n")


def read_run(path: FilePath) -> ScenarioRun:
    """Return the run in a file, or raise a DataError that names the file if it holds no run."""
    path = expand_path("path", path)
    with reading(path.name):
        content = parse_json(read_bytes(path, MAX_JSON_SIZE))
        strata = tuple(map(str, content["strata"]))
        names = [name for name in SCORES if name in content or name not in OPTIONAL]
        scores = {name: np.array(content[name]).reshape(len(strata)) for name in names}
        run = ScenarioRun(
            **{name: content[name] for name in RUN_ENTRIES},
            strata=strata,
            scores=scores,
            worst=_worst_of(content[WORST]) if WORST in content else None,
            origin={str(name): str(part) for name, part in content.get(ORIGIN, {}).items()},
            failures=tuple(map(_failure_of, content.get(FAILURES, ()))),
        )
        for name in ("training_seed", "seed"):
            whole_number(name, getattr(run, name) or 0, at_least=0)
        if (
            name_of_pace(run.pace) != run.pace
            or not strata
            or any(values.dtype.kind not in "bif" for values in scores.values())
        ):
            raise ValueError("it must hold a commanded pace and numbers for each episode")
        if run_path(path.parents[1], run).name != path.name:
            raise ValueError(f"policy must be that of the file's name, got {run.policy!r:.200}")
        return run


def _failure_of(content: object) -> Failure:
    """Return a failure in a run's file, or raise a ValueError."""
    failure = codec().from_plain(content)
    if not isinstance(failure, Failure):
        raise ValueError(f"{FAILURES} must hold failures, got {failure!r:.200}")
    return failure


def _worst_of(content: dict[str, Any]) -> WorstHand:
    """Return the worst hand in a run's file, or raise a ValueError."""
    parts = {name: codec().from_plain(part) for name, part in content.items()}
    kinds = {"machine": Machine, "task": PathFollowing}
    if not all(
        isinstance(part, kinds[name]) if name in kinds else is_finite(part)
        for name, part in parts.items()
    ):
        raise ValueError(f"{WORST} must hold numbers, a machine and a task")
    whole_number("random", parts["random"])
    return WorstHand(**parts)


@lru_cache(1)
def _checkout() -> dict[str, str]:
    """Return the commit of the checkout that runs, if it is one."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():  # installed, perhaps within a repository of somebody else's
        return {}
    git = ("git", "-C", str(root))
    describe = (*git, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    try:
        told = subprocess.run(describe, capture_output=True, text=True, timeout=10.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return {}
    return {"commit": told.stdout.strip()}


def origin_of(policy: AnyPolicy, episodes: Episodes) -> dict[str, str]:
    """Return what makes a run of a policy now, as in ``ScenarioRun.origin``."""
    origin = {"date": datetime.now(UTC).date().isoformat()}
    origin |= {package: metadata.version(package) for package in PACKAGES} | _checkout()
    bound = bind_to(policy, episodes)
    acting = bound if bound.law else policy
    if code := code_digest(acting):
        gains = bound.law.gains.tobytes() if bound.law else b""
        origin[POLICY] = sha256(code.encode() + gains).hexdigest()[:12]
    return origin


def write_trajectories(episodes: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Write episodes one below another to a CSV file, atomically, with all digits of each number.

    ``episodes`` holds telemetry from the reset on, float64 (T + 1, len(TELEMETRY)), by the name of
    the policy. Headings are such as ``policy`` and ``time [s]``. Raises a ParameterError if the
    path does not end in .csv.
    """
    check_csv(path)
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(
        ["policy", *(f.name if f.unit == "1" else f"{f.name} [{f.unit}]" for f in TELEMETRY.fields)]
    )
    for name, telemetry in episodes.items():
        rows.writerows([name, *row] for row in telemetry.tolist())
    write_text_atomic(path, text.getvalue())


def check_csv(path: Path) -> None:
    """Raise a ParameterError unless a table can be written to a file with this extension."""
    if not has_ending(path, ".csv"):
        raise ParameterError(f"csv must end in .csv, got {str(path)!r}")


def run_scenario(
    scenario: str | Scenario | PathFollowing,
    policies: Policies | Iterable[FilePath] | FilePath,
    paces: Iterable[str | float] | float | None = None,
    *,
    episodes: int | None = None,
    seed: int | None = None,
    results: ResultsFolder | FilePath | None = None,
    worst: bool = False,
    faults: bool = False,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[ScenarioRun, ...]:
    """Run policies on the test episodes of a scenario.

    Parameters
    ----------
    scenario
        Its name, or a scenario or a task of your own, as ``find_scenario`` takes them.
    policies
        By name: laws, which are bound to the nominal machine, any ``policy(observations) ->
        volts``, float32 (N, entries) to (N, 4), or what ``find_policy`` takes; a sequence of them
        holds those of several training seeds. Or a list of names that ``find_policy`` takes.
    paces
        Names of commanded paces or speeds [m/s], or one of them; by default all that have names, or
        a task's own.
    episodes
        How many episodes to run, starting with the first; all by default.
    seed
        Seed of test episodes, within [0, 2⁶⁴); by default, the stored ones, or 0 where there are
        none.
    results
        A folder of results or its path, where each run is stored.
    worst
        Whether to search for the worst hand for each policy, too; see ``find_worst``.
    faults
        Whether to run the same episodes with each clutch of the nominal machine dead, with half of
        its torque, and stuck on, too; the scenario of these runs is called
        ``"standard, clutch 1 dead"``, and so on.
    num_threads
        Threads that share the episodes of a compiled law, ≥ 1; scores do not depend on their
        number.
    on_progress
        Called with the name of each policy and pace when it is done.

    Raises
    ------
    ParameterError
        If there is no such scenario, policy or pace, or there are fewer episodes than requested.
    DataError
        If stored test episodes are damaged.
    """
    num_threads = whole_number("num_threads", num_threads)
    if paces is None:
        paces = scenario.pace if isinstance(scenario, PathFollowing) else tuple(PACES)
    scenario = find_scenario(scenario)
    pace_names = names_of_paces(paces)
    seed = 0 if seed is None and scenario.digest else seed
    sets = {pace: find_episodes(scenario, pace, seed) for pace in pace_names}
    by_name = find_policies(policies, scenario.whose_gains)
    if episodes is not None:
        sets = {pace: full.first(episodes) for pace, full in sets.items()}
    if results is not None:
        results = results if isinstance(results, ResultsFolder) else ResultsFolder(results)
        results.make()
    first = next(iter(sets.values()))
    for policy in (each for versions in by_name.values() for each in versions):
        check_acting(policy, first)
    origins = {
        name: [origin_of(policy, first) for policy in versions]
        for name, versions in by_name.items()
    }
    kinds: dict[str, tuple[Failure, ...]] = {scenario.name: ()}
    for title, failure in faults_of(scenario.nominal).items() if faults else ():
        kinds[scenario.name + title] = (failure,)
    runs: list[ScenarioRun] = []
    for (title, failures), (pace, healthy) in product(kinds.items(), sets.items()):
        episode_set = healthy.with_task(failures=failures) if failures else healthy
        for name, versions in by_name.items():
            trained = [
                ScenarioRun(
                    title,
                    pace,
                    name,
                    number,
                    seed,
                    episode_set.strata,
                    evaluate(policy, episode_set, num_threads),
                    digest=scenario.digest,
                    worst=find_worst(policy, scenario, pace, num_threads=num_threads)
                    if worst and not failures
                    else None,
                    origin=origins[name][number],
                    failures=failures,
                )
                for number, policy in enumerate(versions)
            ]
            if results:
                results.add(trained)
            runs += trained
            on_progress(f"{name}, {pace}")
    return tuple(runs)
