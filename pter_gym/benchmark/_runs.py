"""One policy on the episodes of one scenario at one pace: what was run, and its scores."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.sources import meaning_of
from pter_gym.benchmark.episodes import DERIVED
from pter_gym.benchmark.metrics import SCORES, Scores
from pter_gym.errors import ParameterError
from pter_gym.policies._files import LONGEST_NAME

Array = NDArray[np.float64]

PACKAGE = Path(__file__).parents[1]

DECIDING = (
    "units.py",
    "_compiled",
    "params",
    "_physics",
    "hands",
    "paths",
    "tasks",
    "_engine",
    "scenarios",
    "controllers",
    "policies",
    "benchmark/episodes.py",
    "benchmark/_evaluation.py",
    "benchmark/_measures.py",
    "benchmark/metrics.py",
    "benchmark/ranking.py",
    "benchmark/_recorded.py",
    "benchmark/simulation.py",
    "benchmark/statistics.py",
    "presets/pter.toml",
)
"""The folders and files of the package that decide a score. Gains and weights are part of a policy's identity."""

SAMPLES = 4
"""Episodes of a run that are kept to be drawn: the first of each stratum, then the first ones."""

INSTANTS = 200
"""Largest number of instants that are kept of such an episode."""


@dataclass(frozen=True)
class Sample:
    """One episode for plotting, at some of its control instants.

    Attributes
    ----------
    episode
        Its number in the scenario.
    tip
        Tip position [m], shape (K, 2).
    theta
        Absolute link angles [rad], shape (K, 2).
    """

    episode: int
    tip: Array
    theta: Array


@dataclass(frozen=True)
class Planning:
    """How a planner made its decisions.

    Attributes
    ----------
    privileged
        Whether it uses information that no controller can have.
    horizon_s
        Planning horizon [s].
    rollouts
        Number of plans simulated for each decision.
    decision_ms
        Measured mean CPU time of a decision [ms], independent of other load on the computer.
    """

    privileged: bool
    horizon_s: float
    rollouts: int
    decision_ms: float


@dataclass(frozen=True)
class Conditions:
    """Everything that the scores of a run depend on.

    Attributes
    ----------
    scenario, pace, policy
        Names.
    seed
        Number of the training seed, for a policy that was trained with several; 0 otherwise.
    episodes
        How many of the scenario's episodes were run, starting with the first.
    data
        SHA-256 of the episodes.
    identity
        SHA-256 of the policy's content; None if that cannot be known, as for a plain function.
    version
        Of the package.
    code
        SHA-256 of the code that decides scores.
    fresh
        Seed of fresh episodes, or ``derived``; None for the stored ones.
    """

    scenario: str
    pace: str
    policy: str
    seed: int
    episodes: int
    data: str
    identity: str | None
    version: str
    code: str
    fresh: int | str | None = None

    @property
    def config_hash(self) -> str:
        """Hash of all of them except the policy."""
        parts = {name: part for name, part in asdict(self).items() if name not in ("policy", "seed", "identity")}
        return _sha256({**parts, "data": self.shared_data})

    @property
    def shared_data(self) -> str | None:
        """SHA-256 of the episodes if all policies share them; None where each has its own."""
        return None if self.fresh == DERIVED else self.data

    @property
    def fresh_seed(self) -> int | None:
        """Seed of the fresh episodes, None for the stored ones."""
        if not isinstance(self.fresh, str):
            return self.fresh
        return derived_seed(self.policy, self.identity, self.scenario)


@dataclass(frozen=True)
class ScenarioRun:
    """The scores of one policy on the episodes of one scenario at one pace.

    Attributes
    ----------
    conditions
        What was run.
    strata
        One label per episode.
    scores
        One entry per episode under each name.
    samples
        Some episodes for plotting.
    planning
        For a policy that plans.
    """

    conditions: Conditions
    strata: tuple[str, ...]
    scores: Scores
    samples: tuple[Sample, ...]
    planning: Planning | None = None


def derived_seed(policy: str, identity: str | None, scenario: str) -> int:
    """Return the seed of a policy's own fresh episodes, determined by its content so that nobody can tune to them.

    It is the first 8 bytes of a SHA-256 of the content of the policy, the code that decides scores and the scenario.

    Raises
    ------
    ParameterError
        If the content of the policy cannot be known; the message names the policy.
    """
    if identity is None:
        raise ParameterError(
            f"fresh must be a whole number for {policy!r}: what that callable does cannot be known, so no seed can "
            "follow from it"
        )
    return int(_sha256([identity, code_digest(), scenario])[:16], 16)


def _sha256(parts: object) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def check_name(name: object) -> None:
    """Raise a ParameterError unless something can name a policy in tables and in file names."""
    good = isinstance(name, str) and name.strip() == name != "" and name.isprintable()
    if not good or len(quote(str(name), safe=" ")) > LONGEST_NAME:
        raise ParameterError(
            f"policies must have names of 1 to {LONGEST_NAME} printable characters, without a space at either end (one "
            f"that a file name cannot hold counts as three or more), got {name!r:.60}"
        )


def join_seeds(runs: Sequence[ScenarioRun]) -> ScenarioRun:
    """Join the runs of one policy's training seeds on the same episodes into one; seeds become a further stratum.

    Its identity is unknown if any of theirs is, and it plans, or is privileged, if any of them does or is.
    """
    if len(runs) == 1:
        return runs[0]
    identities = [run.conditions.identity for run in runs]
    known = None if None in identities else "; ".join(map(str, identities))
    plans = sorted((run.planning for run in runs if run.planning), key=lambda planning: not planning.privileged)
    return ScenarioRun(
        conditions=replace(runs[0].conditions, identity=known),
        strata=tuple(f"{stratum}, seed {run.conditions.seed}" for run in runs for stratum in run.strata),
        scores={name: np.concatenate([run.scores[name] for run in runs]) for name in SCORES},
        samples=runs[0].samples,
        planning=plans[0] if plans else None,
    )


def without_copies(runs: Iterable[ScenarioRun]) -> tuple[tuple[ScenarioRun, ...], tuple[tuple[ScenarioRun, int], ...]]:
    """Return the runs that count, and those whose policy equals that of an earlier training seed, with that seed.

    A copy does not count as another seed. Policies of unknown content are equal if all their scores are.
    """
    first: dict[tuple[object, ...], int] = {}
    kept: list[ScenarioRun] = []
    copies: list[tuple[ScenarioRun, int]] = []
    for run in sorted(runs, key=lambda run: run.conditions.seed):
        at = run.conditions
        scores = () if at.identity else tuple(values.tobytes() for values in run.scores.values())
        seed = first.setdefault((replace(at, seed=0), *scores), at.seed)
        if seed == at.seed:
            kept.append(run)
        else:
            copies.append((run, seed))
    return tuple(kept), tuple(copies)


def sample_numbers(strata: Sequence[str]) -> list[int]:
    """Return the numbers of the episodes that are kept for plotting."""
    first_of_each = (strata.index(stratum) for stratum in dict.fromkeys(strata))
    return sorted(list(dict.fromkeys([*first_of_each, *range(len(strata))]))[:SAMPLES])


def other_score(code: object) -> str:
    """Return a message that a file was made with another score, whose digest differs from this code's."""
    return f"it is of an older score, or of other code: {code!s:.12} instead of {code_digest():.12}"


@cache
def code_digest() -> str:
    """Return a SHA-256 of the code that determines scores: if it differs, an earlier run cannot be reused.

    It covers the syntax trees of ``DECIDING`` without docstrings, so it depends neither on comments and layout nor on
    the Python version.

    Raises
    ------
    FileNotFoundError
        If one of them does not exist.
    """
    content = hashlib.sha256()
    for part in DECIDING:
        place = PACKAGE / part
        files = [place] if place.is_file() else sorted(place.rglob("*.py"))
        if not files:
            raise FileNotFoundError(f"{place} decides scores and does not exist: correct DECIDING in {__file__}")
        for path in files:
            content.update(f"{path.relative_to(PACKAGE).as_posix()}: {meaning_of(path)}\n".encode())
    return content.hexdigest()
