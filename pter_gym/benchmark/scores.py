"""Scores of episodes, each declared once: a field of ``Score`` with unit, meaning and function."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._physics.friction import ClutchMode
from pter_gym._version import __version__
from pter_gym.benchmark.cells import millimetres, percent
from pter_gym.benchmark.measures import PRICE, TOUCH, Array, Recorded, column, mean_over
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.tasks.path_following import TELEMETRY, Failure, PathFollowing

Values = NDArray[Any]

Scores = dict[str, Values]
"""The defined scores by name, (N,) for N episodes; ``completed`` is bool, others float64."""


class Metric(NamedTuple):
    """A score: its unit, its meaning, and what computes it for N episodes, (N,) or None.

    None is for scores that are not defined.
    """

    unit: str
    meaning: str
    find: Callable[[Recorded], Values | None]


def _score(
    unit: str, meaning: str, find: Callable[[Recorded], Values | None], **options: Any
) -> Any:
    return field(metadata={"metric": Metric(unit, meaning, find)}, **options)


@dataclass(frozen=True, kw_only=True)
class Score:
    """Scores of one episode.

    Every score is finite, whatever the episode. Accelerations leave out the start-up interval,
    unless the episode ends within it, and are low-pass filtered. The last is None where it is not
    defined.
    """

    path_error_m: float = _score(
        "m",
        "mean over ten segments of the larger of ∫|e|dt/t and ∫|e|ds/(L/10), times "
        f"r^{PRICE:g} if r = t·v/(L/10) > 1, else {1.0 + PRICE:g} − {PRICE:g}r; at most the "
        "largest |e| or the workspace's bound, whichever is larger",
        Recorded.path_error,
    )
    rms_error_m: float = _score("m", "√(∫e²ds/L); ranks do not use it", Recorded.rms_error)
    mean_error_m: float = _score(
        "m", "time average of |e|; ranks do not use it", Recorded.mean_error
    )
    path_average_error_m: float = _score(
        "m", "path average ∫|e|ds/L; ranks do not use it", Recorded.path_average
    )
    mean_pace_error: float = _score(
        "1", "|T·v/L − 1| with the commanded pace v", Recorded.mean_pace_error
    )
    segment_pace_error: float = _score(
        "1", "mean of |t·v/(L/10) − 1| over ten segments", Recorded.segment_pace_error
    )
    mean_pace_m_s: float = _score("m/s", "mean speed along the path", Recorded.mean_pace)
    mean_speed_m_s: float = _score(
        "m/s", "time average of the tip's speed", lambda e: e.mean(e.speed)
    )
    mean_acceleration_m_s2: float = _score(
        "m/s²", "time average", lambda e: mean_over(e.acceleration, e.counted)
    )
    rms_acceleration_m_s2: float = _score(
        "m/s²",
        "root of the mean square",
        lambda e: np.sqrt(mean_over(e.acceleration**2, e.counted)),
    )
    peak_acceleration_m_s2: float = _score(
        "m/s²", "largest", lambda e: np.where(e.counted, e.acceleration, 0.0).max(axis=0)
    )
    smoothness: float = _score(
        "1", "−ln of the dimensionless jerk; larger is smoother", Recorded.smoothness
    )
    mean_force_n: float = _score(
        "N", "time average of the size of the hand's force", lambda e: e.mean(e.force)
    )
    peak_force_n: float = _score("N", "its largest size", lambda e: e.force.max(axis=0))
    resisting_force_n: float = _score(
        "N",
        "mean force of the clutches against the tip's motion, while it moves; of `free`, the drag "
        "of free motion",
        Recorded.resisting_force,
    )
    path_length_m: float = _score("m", "distance travelled by the tip", Recorded.distance_travelled)
    completed: bool = _score("1", "the end of the path was reached", Recorded.completed)
    duration_s: float = _score("s", "length of the episode", lambda e: e.end)
    effort: float = _score(
        "1",
        "mean of (V/V_max)² over time and clutches",
        lambda e: e.mean(((e.volts / e.voltage_max) ** 2).mean(axis=-1)),
    )
    dissipated_j: float = _score(
        "J", "energy taken by the clutches", lambda e: e.total("dissipated")
    )
    hand_work_j: float = _score("J", "work of the hand", lambda e: e.total("hand_work"))
    saturated: float = _score(
        "1",
        "fraction of the time with a clutch at its largest voltage",
        lambda e: e.mean((e.volts >= (1.0 - 1e-6) * e.voltage_max).any(axis=-1)),
    )
    stuck: float = _score(
        "1",
        "fraction of the time at zero degrees of freedom",
        lambda e: e.mean(column(e.steps, "mode") == ClutchMode.ZERO_DOF),
    )
    apparent_stiffness_n_m: float | None = _score(
        "N/m",
        "of a fixture's edge: least-squares slope of the hand's force into it over a penetration "
        f"of more than {1e3 * TOUCH:g} mm, damping and friction included; 0 if there was none",
        Recorded.apparent_stiffness,
        default=None,
    )


METRICS: Mapping[str, Metric] = {item.name: item.metadata["metric"] for item in fields(Score)}
"""What each score is, by its name."""

SCORES = tuple(METRICS)

OPTIONAL = frozenset(item.name for item in fields(Score) if item.default is None)
"""The scores that are not defined for every policy and scenario."""


def score(telemetry: Array, task: PathFollowing, machine: Machine | str | None = None) -> Score:
    """Score one episode.

    Parameters
    ----------
    telemetry
        Shape (steps + 1, len(TELEMETRY)): the row of the reset, then one row per control step.
    task
        The task that was followed.
    machine
        The machine that followed it, as ``find_machine`` takes it; PTER by default.

    Raises
    ------
    ParameterError
        If the telemetry has another shape or no step, or there is no such machine.
    """
    scores = score_episodes(np.asarray(telemetry)[:, None], [task], machine)
    return Score(**{name: values[0].item() for name, values in scores.items()})


def score_episodes(
    telemetry: Array, tasks: Sequence[PathFollowing], machine: Machine | str | None = None
) -> Scores:
    """Score many episodes at once, each independently of the others.

    Parameters
    ----------
    telemetry
        Shape (T + 1, N, len(TELEMETRY)): the rows of the reset, then one per control step, NaN
        after the end of an episode.
    tasks
        The tasks that were followed, N of them, with one control period.
    machine
        The machine that followed them, or one of them: all have one largest voltage. PTER by
        default.

    Raises
    ------
    ParameterError
        If the telemetry has another shape, an episode has no step, or there is no such machine.
    """
    shape = np.shape(telemetry)
    if len(shape) != 3 or shape[0] < 2 or shape[1:] != (len(tasks), len(TELEMETRY)):
        raise ParameterError(
            f"telemetry must have the shape (T + 1, {len(tasks)}, {len(TELEMETRY)}) with at least "
            f"one step, got {shape}"
        )
    runs = np.isfinite(column(telemetry[1], "time"))
    if not runs.all():
        raise ParameterError(
            f"telemetry must hold at least one step of each episode, got none of {runs.argmin()}"
        )
    episodes = Recorded(telemetry, tasks, find_machine(machine).clutch.voltage_max)
    scores = {name: metric.find(episodes) for name, metric in METRICS.items()}
    return {name: values for name, values in scores.items() if values is not None}


CONFIDENCE = 0.999
"""Confidence with which random episodes say how rare worse ones are."""


@dataclass(frozen=True)
class WorstHand:
    """The episode with the largest path error of those tried, and the evidence of random ones.

    Attributes
    ----------
    path_error_m
        Its path error [m], a lower bound on the largest possible one.
    random_error_m
        Largest path error [m] of a random episode.
    random, tried
        Number of random episodes and of all episodes; 1 if the scenario has only one.
    machine, task
        Machine and task of the episode, whose seed is 0.
    """

    path_error_m: float
    random_error_m: float
    random: int
    tried: int
    machine: Machine
    task: PathFollowing

    @property
    def one_in(self) -> int:
        """N: with ``CONFIDENCE``, at most one episode in N is worse than all random ones.

        Of episodes with a share p of worse ones, n random ones have none with the probability
        (1 − p)ⁿ, so p is at most 1 − (1 − CONFIDENCE)^(1/n) (Clopper and Pearson, Biometrika 26,
        1934).
        """
        return math.floor(1.0 / -math.expm1(math.log(1.0 - CONFIDENCE) / self.random))

    def as_json(self) -> dict[str, float]:
        """Return its numbers as plain data."""
        names = ("path_error_m", "random_error_m", "random", "tried", "one_in")
        return {name: getattr(self, name) for name in names}

    def sentence(self, policy: str) -> str:
        """Return a sentence for reports."""
        worst = f"gives {policy} {millimetres(self.path_error_m)} mm"
        if self.tried == 1:
            return f"The scenario's only episode {worst}."
        return (
            f"The worst of {self.tried:,} episodes {worst}; with {percent(CONFIDENCE)} confidence "
            f"at most one random episode in {self.one_in:,} gives more than "
            f"{millimetres(self.random_error_m)} mm."
        )


POLICY = "policy"
"""Entry of a run's origin: the digest of the policy, where its code is known."""


@dataclass(frozen=True)
class ScenarioRun:
    """The scores of one policy on the episodes of one scenario at one pace.

    Attributes
    ----------
    training_seed
        Number of the training seed, for a policy that was trained with several; 0 otherwise.
    seed
        Seed of test episodes; None for the stored ones.
    digest
        Digest of a user's scenario, whose name need not be unique; empty for the suite's.
    worst
        The worst hand for the policy, if one was searched for.
    origin
        Where it comes from: date, versions of packages, the commit of a checkout, and the digest of
        the policy: of a law's code with its gains or weights, otherwise of the file of its code.
    failures
        What fails in all episodes, beside what the scenario draws.
    strata, scores
        A label for each episode; by the name of each defined score, an array with an entry for each
        episode.
    """

    scenario: str
    pace: str
    policy: str
    training_seed: int
    seed: int | None
    strata: tuple[str, ...]
    scores: Scores
    version: str = __version__
    digest: str = ""
    worst: WorstHand | None = None
    origin: Mapping[str, str] = field(default_factory=dict[str, str], compare=False)
    failures: tuple[Failure, ...] = ()

    @property
    def episodes(self) -> int:
        """How many of the scenario's episodes were run, starting with the first."""
        return len(self.strata)
