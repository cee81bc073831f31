"""Results made by hand, in which any number of policies at any paces have scores that are worth drawing."""

import numpy as np
from numpy.typing import NDArray

from pter_gym.benchmark import Leaderboard
from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.metrics import METRICS
from pter_gym.benchmark.ranking import Standing
from pter_gym.benchmark.runs import Conditions, Sample, ScenarioRun
from pter_gym.benchmark.statistics import Interval
from pter_gym.params import BASELINE
from pter_gym.plots.benchmark import Trace
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

Array = NDArray[np.float64]

TASK = PathFollowing()
LENGTH = TASK.path.length
NAMES = (
    "torque-feedback",
    "residual",
    "single-dof-tuned",
    "policies/one-that-somebody-exported-yesterday",
    "locked",
    "torque-feedback-tuned",
    "velocity-ratio-tuned",
    "impedance-tuned",
    "ppo-standard",
    "predictive-honest",
    "impedance",
    "mine",
)
STRATA = ("rounded corners", "line", "sine", "spline")
SAMPLED = 60


def trace(name: str, place: int) -> Trace:
    """An episode that passes the end of the path, if its place is no multiple of five."""
    rows = telemetry(place)
    tip = np.stack([rows[:, TELEMETRY.index(each)] for each in ("tip_x", "tip_y")], axis=1)
    columns = (rows[:, TELEMETRY.index(each)] for each in ("time", "normal_error"))
    time, error = columns
    return Trace(name, (1.0 + 0.1 * place) * time, tip, error, place % 5 > 0)


def telemetry(place: int, steps: int = 120) -> Array:
    """An episode along the path, off it by up to a few centimetres, with clutches that stick and saturate at times."""
    part = np.linspace(0.0, 1.0, steps + 1)
    error = 0.006 * (place + 1) * np.sin((3.0 + 0.3 * place) * part) * np.exp(-part)
    rows = np.zeros((steps + 1, len(TELEMETRY)))
    tip = np.array([TASK.path.point(float(s)) for s in LENGTH * part])
    tip[:, 1] += error
    values = {
        "time": 0.012 * np.arange(steps + 1),
        "arc_length": LENGTH * part,
        "reached": LENGTH * part,
        "normal_error": error,
        "tip_x": tip[:, 0],
        "tip_y": tip[:, 1],
        "theta_a": np.full(steps + 1, 0.6) + 0.8 * part,
        "theta_b": np.full(steps + 1, 2.2) - 0.4 * part,
        "mode": np.floor(6.0 * part) % 6.0,
        **{f"volts_{k}": np.clip(24.0 * np.sin(5.0 * part + k + place), 0.0, 24.0) for k in range(1, 5)},
    }
    for name, column in values.items():
        rows[:, TELEMETRY.index(name)] = column
    return rows


def boards(count: int, paces: int) -> list[Leaderboard]:
    """Leaderboards of the first names; a third has no rank, and the fifth hardly moves."""
    return [
        Leaderboard("everything", pace, 8, "", "", tuple(_standing(k, pace) for k in range(count)))
        for pace in list(PACES)[-paces:]
    ]


def _standing(k: int, pace: str) -> Standing:
    error = 0.002 * 1.35**k * (1.0 + 0.4 * list(PACES).index(pace))
    mean_pace = 0.001 if NAMES[k] == "locked" else PACES[pace] * (1.0 + 0.02 * (k - 4))
    values = dict.fromkeys(METRICS, 1.0) | {
        "path_error_m": error,
        "mean_pace_m_s": mean_pace,
        "smoothness": -9.0 + 0.4 * k,
    }
    scores = {name: Interval(value, 0.95 * value, 1.08 * value) for name, value in values.items()}
    reason = "arrives too rarely" if k % 3 == 2 or NAMES[k] == "locked" else None
    return Standing(NAMES[k], None, None if reason else k + 1, reason, scores)


def runs(count: int, paces: int) -> list[ScenarioRun]:
    """The runs that those leaderboards rank."""
    found = []
    for board in boards(count, paces):
        for k, standing in enumerate(board.standings):
            at = Conditions("everything", board.pace, standing.policy, 0, 8, "", None, "", "")
            errors = standing.scores["path_error_m"].value * np.geomspace(0.4, 2.5, 8)
            scores = {name: errors if name == "path_error_m" else np.ones(8) for name in METRICS}
            found.append(ScenarioRun(at, 2 * STRATA, scores, tuple(_sample(k, episode) for episode in range(4))))
    return found


def _sample(place: int, episode: int) -> Sample:
    rows = telemetry(place, SAMPLED)
    theta = np.stack([rows[:, TELEMETRY.index(name)] for name in ("theta_a", "theta_b")], axis=1)
    return Sample(episode, np.stack([rows[:, TELEMETRY.index(name)] for name in ("tip_x", "tip_y")], axis=1), theta)


def episodes() -> Episodes:
    """The episodes of the samples."""
    return Episodes("everything", "", 8 * (BASELINE,), 8 * (TASK,), tuple(range(8)), 2 * STRATA)
