"""One policy on the episodes of one scenario at one pace: its scores, and the file that holds them."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pter_gym._version import __version__
from pter_gym.benchmark.metrics import SCORES, Scores
from pter_gym.internal.files import write_text_atomic

Array = NDArray[np.float64]

PACKAGE = Path(__file__).parents[1]


@dataclass(frozen=True)
class Sample:
    """One episode as it is drawn, at some of its control instants.

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
    """How a policy that plans came to its decisions.

    Attributes
    ----------
    privileged
        Whether it knows what no controller can know.
    horizon_s
        Time that a plan covers [s].
    rollouts
        Plans that are simulated for each decision.
    decision_ms
        Measured mean processor time of a decision [ms], which does not depend on what else the machine does.
    """

    privileged: bool
    horizon_s: float
    rollouts: int
    decision_ms: float


@dataclass(frozen=True)
class Conditions:
    """All that the scores of a run depend on.

    Attributes
    ----------
    scenario, pace, policy
        Names.
    seed
        Number of the training seed, for a policy that was trained with several; 0 otherwise.
    episodes
        How many of the scenario's episodes were run, from the first on.
    data
        SHA-256 of the stored episodes.
    identity
        What the policy is, gains and law included; None if that cannot be told, as of a plain function.
    version
        Of the package.
    code
        SHA-256 of the package's sources.
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

    @property
    def key(self) -> str | None:
        """Hash of all of them, or None if the policy is unknown: then no earlier run is known to be the same."""
        if self.identity is None:
            return None
        return _hash(asdict(self))

    @property
    def config_hash(self) -> str:
        """Hash of all of them but the policy."""
        return _hash({name: part for name, part in asdict(self).items() if name not in ("policy", "seed", "identity")})


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
        Some episodes to draw.
    planning
        Of a policy that plans.
    """

    conditions: Conditions
    strata: tuple[str, ...]
    scores: Scores
    samples: tuple[Sample, ...]
    planning: Planning | None = None


def join_seeds(runs: Sequence[ScenarioRun]) -> ScenarioRun:
    """Return the runs of one policy's training seeds on the same episodes as one run; seeds are a further stratum."""
    if len(runs) == 1:
        return runs[0]
    return ScenarioRun(
        conditions=replace(runs[0].conditions, identity="; ".join(str(run.conditions.identity) for run in runs)),
        strata=tuple(f"{stratum}, seed {run.conditions.seed}" for run in runs for stratum in run.strata),
        scores={name: np.concatenate([run.scores[name] for run in runs]) for name in SCORES},
        samples=runs[0].samples,
        planning=runs[0].planning,
    )


def run_path(folder: Path, conditions: Conditions) -> Path:
    """Return the file of a run in a folder of results."""
    name = "-".join((conditions.scenario, conditions.pace, conditions.policy, str(conditions.episodes)))
    name += f"-seed{conditions.seed}" if conditions.seed else ""
    return folder / "runs" / f"{quote(name, safe=' ')}.json"


def write_run(folder: Path, run: ScenarioRun) -> None:
    """Write a run to its file, whole or not at all."""
    path = run_path(folder, run.conditions)
    content = {
        "key": run.conditions.key,
        **asdict(run.conditions),
        "strata": run.strata,
        "planning": run.planning and asdict(run.planning),
        "scores": {name: values.tolist() for name, values in run.scores.items()},
        "samples": [
            {"episode": sample.episode, "tip_m": sample.tip.tolist(), "theta_rad": sample.theta.tolist()}
            for sample in run.samples
        ],
    }
    write_text_atomic(path, json.dumps(content, allow_nan=False) + "\n")


def read_run(path: Path) -> ScenarioRun | None:
    """Return the run in a file, or None if there is no whole run in it."""
    try:
        content: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
        conditions = Conditions(**{name: content[name] for name in Conditions.__dataclass_fields__})
        run = ScenarioRun(
            conditions,
            tuple(content["strata"]),
            {name: np.array(content["scores"][name]) for name in SCORES},
            tuple(
                Sample(sample["episode"], np.array(sample["tip_m"]), np.array(sample["theta_rad"]))
                for sample in content["samples"]
            ),
            content["planning"] and Planning(**content["planning"]),
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return run if content["key"] == conditions.key and _is_whole(run) else None


def _is_whole(run: ScenarioRun) -> bool:
    """Tell whether there is a number for each episode under each name."""
    count = run.conditions.episodes
    numbers = all(values.shape == (count,) and values.dtype.kind in "bif" for values in run.scores.values())
    return numbers and len(run.strata) == count


def _refuse(constant: str) -> float:
    raise ValueError(f"scores are finite, and not {constant}")


def _hash(parts: Mapping[str, object]) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return a SHA-256 of the package's sources and presets: with other code, an earlier run is not the same run."""
    content = hashlib.sha256(__version__.encode())
    for path in sorted(path for pattern in ("*.py", "*.toml") for path in PACKAGE.rglob(pattern)):
        content.update(path.relative_to(PACKAGE).as_posix().encode())
        content.update(path.read_bytes())
    return content.hexdigest()
