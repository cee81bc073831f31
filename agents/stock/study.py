"""What stock algorithms learn, by environment steps and by seconds of a core.

    python agents/stock/study.py --algorithms SAC PPO --seeds 1 2 3
    python agents/stock/study.py --seeds 1 2 3 4 5 --out curves.csv --picture curves.png

Trains each algorithm of Stable-Baselines3 and sb3-contrib as its row of `CALLS` says, once with
each seed, and assesses it along the way on held-out training episodes at each pace. The best model
by these is then scored on test episodes; with `--assessments 0`, the last one. All of it is
appended to a CSV file; what is already there is not trained again. Ends with a table: the test
scores, and how many steps, and seconds of a core, a seed needs to come below the errors of
`LEVELS` at every pace.
"""

import csv
from collections.abc import Iterable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import sb3_contrib as contrib
import stable_baselines3 as sb3
import torch
import tyro
from matplotlib.figure import Figure
from stable_baselines3.common.noise import NormalActionNoise

from pter_gym.benchmark import from_sb3, leaderboards, run_scenario
from pter_gym.envs.sb3 import PathErrorCallback, make_sb3_vec_env
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import RewardWeights
from pter_gym.tools.figures import COLOURS, WIDTH, label, png, styled
from pter_gym.tools.pictures.plots import plain_ticks


class Call(NamedTuple):
    """How an algorithm is called: worlds, environment steps, and what differs from its defaults."""

    made: Any
    worlds: int
    steps: int
    settings: dict[str, Any]
    env: dict[str, Any] = {}


ROLLOUTS = {"n_steps": 64, "gae_lambda": 0.98}
UPDATES = {"gradient_steps": 4}
ENTROPY = {"ent_coef": "auto_0.01", **UPDATES}
NARROW = {**ENTROPY, "policy_kwargs": {"net_arch": {"pi": [256, 256], "qf": [256, 256]}}}
NOISE = {"action_noise": NormalActionNoise(np.zeros(4), np.full(4, 0.2)), **UPDATES}
SMOOTH = {"use_sde": True, "sde_sample_freq": 8, "policy_kwargs": {"log_std_init": -2.9}}
COSTLY = {"reward": RewardWeights(effort=60)}
BASE = {"base": "single-dof-tuned"}
CLOSE = RewardWeights(tracking=10, precision=90, effort=0)
NEAR = {"starts": "rest", "error_max": 0.05, "reward": CLOSE}
CALLS = {
    "PPO": Call(sb3.PPO, 64, 1_250_000, {**ROLLOUTS, "batch_size": 1024}),
    "A2C": Call(sb3.A2C, 64, 5_000_000, {**ROLLOUTS, "n_steps": 16, "normalize_advantage": True}),
    "TRPO": Call(contrib.TRPO, 64, 1_250_000, ROLLOUTS),
    "SAC": Call(sb3.SAC, 16, 100_000, ENTROPY),
    "TQC": Call(contrib.TQC, 16, 100_000, ENTROPY),
    "CrossQ": Call(contrib.CrossQ, 16, 100_000, NARROW),
    "TD3": Call(sb3.TD3, 16, 100_000, NOISE, COSTLY),
    "DDPG": Call(sb3.DDPG, 16, 100_000, NOISE),
    "PPO, library defaults": Call(sb3.PPO, 4, 1_500_000, {}),
    "SAC, library defaults": Call(sb3.SAC, 1, 300_000, {}),
    "PPO on a law": Call(
        sb3.PPO,
        128,
        5_000_000,
        {**ROLLOUTS, "batch_size": 2048, "gamma": 0.995, **SMOOTH},
        {**BASE, **NEAR},
    ),
    "SAC on a law": Call(sb3.SAC, 16, 100_000, ENTROPY, BASE),
    "TD3 on a law": Call(sb3.TD3, 16, 100_000, NOISE, BASE),
}
LEVELS = (28.0, 27.0, 35.0), (10.0, 10.0, 20.0)
"""Path errors at the slow, medium and brisk pace [mm]: those of the paper's better law with tuned
gains, and a third of them."""


class Row(NamedTuple):
    """Errors of a model [mm], at how many paces it is ranked, and what it took to train it."""

    algorithm: str
    seed: int
    episodes: str
    steps: int
    seconds: float
    slow: float
    medium: float
    brisk: float
    ranked: int

    @property
    def errors(self) -> tuple[float, float, float]:
        return self.slow, self.medium, self.brisk


HELD_OUT, TEST = "held-out", "test"
"""Training episodes that no training sees, and the benchmark's."""


class Curve(PathErrorCallback):
    """Assesses the model, and knows how many seconds the training has taken without that."""

    def __init__(self, folder: str, every: int) -> None:
        super().__init__(every, folder, verbose=0)
        self.seconds: list[float] = []
        self._began, self._spent = process_time(), 0.0

    def _assess(self) -> None:
        self._spent += process_time() - self._began
        self.seconds.append(round(self._spent, 1))
        super()._assess()
        self._began = process_time()


def train(algorithm: str, seed: int, steps: int | None, assessments: int, fresh: int) -> list[Row]:
    """Return the assessments of a training, and the test scores of its best or last model."""
    call = CALLS[algorithm]
    total = steps or call.steps
    worlds = make_sb3_vec_env(call.worlds, scenario="standard", **call.env)
    model = call.made("MlpPolicy", worlds, seed=seed, device="cpu", **call.settings)
    with TemporaryDirectory() as folder:
        curve = Curve(folder, max(total // max(assessments, 1), 1))
        began = process_time()
        model.learn(total, curve if assessments else None)
        spent = curve.seconds[-1] if assessments else round(process_time() - began, 1)
        best = call.made.load(Path(folder) / "best_model", worlds) if assessments else model
    rows = [
        Row(
            *(algorithm, seed, HELD_OUT, found.steps, seconds),
            *(round(1e3 * found.paces[pace].path_error_m, 1) for pace in PACES),
            sum(each.ranked for each in found.paces.values()),
        )
        for found, seconds in zip(curve.assessments, curve.seconds, strict=True)
    ]
    runs = run_scenario("standard", {algorithm: from_sb3(best)}, seed=fresh)
    errors = (round(1e3 * float(run.scores["path_error_m"].mean()), 1) for run in runs)
    ranks = sum(board.standings[0].rank is not None for board in leaderboards(runs))
    return [*rows, Row(algorithm, seed, TEST, model.num_timesteps, spent, *errors, ranks)]


def read(path: Path) -> list[Row]:
    """Return the rows of a CSV file, none if it is missing."""
    if not path.exists():
        return []
    kinds = Row.__annotations__.values()
    with path.open(newline="") as lines:
        return [
            Row(*(kind(value) for kind, value in zip(kinds, row, strict=True)))
            for row in list(csv.reader(lines))[1:]
        ]


def append(path: Path, rows: Iterable[Row]) -> None:
    """Append rows to a CSV file."""
    is_new = not path.exists()
    with path.open("a", newline="") as lines:
        csv.writer(lines, lineterminator="\n").writerows([Row._fields] * is_new + list(rows))


def first_below(rows: list[Row], level: tuple[float, ...]) -> Row | None:
    """Return the first assessment with smaller errors and a rank at each pace, None without one."""
    for row in rows[:-1]:
        below = all(error <= most for error, most in zip(row.errors, level, strict=True))
        if below and row.ranked == len(PACES):
            return row
    return None


def amount(rows: list[Row | None], kind: str) -> str:
    """Return the median of steps or seconds, – if that seed did not get there."""
    middle = median(getattr(row, kind) if row else float("inf") for row in rows)
    return "–" if middle == float("inf") else f"{middle:,.0f}"


def print_table(rows: list[Row]) -> None:
    """Print, for each algorithm, its seeds at the end and how soon they come below the levels."""
    print("| Algorithm | Ranked | Median [mm] | Steps, seconds |", end="")
    print("".join(f" Below {'/'.join(map('{:g}'.format, level))} mm |" for level in LEVELS))
    print("|---" * (4 + len(LEVELS)) + "|")
    each_seed: list[str] = []
    for algorithm in dict.fromkeys(row.algorithm for row in rows):
        own = [row for row in rows if row.algorithm == algorithm]
        runs = [[row for row in own if row.seed == seed] for seed in sorted({r.seed for r in own})]
        ends = [run[-1] for run in runs]  # on test episodes
        ranked = sum(end.ranked == len(PACES) for end in ends)
        errors = "/".join(f"{median(e):.1f}" for e in zip(*(e.errors for e in ends), strict=True))
        cells = [algorithm, f"{ranked} of {len(ends)}", errors]
        cells.append(f"{ends[0].steps:,}, {median(end.seconds for end in ends):.0f}")
        for level in LEVELS:
            found = [first_below(run, level) for run in runs]
            there = f"{sum(row is not None for row in found)} of {len(runs)}"
            cells.append(f"{there}, {amount(found, 'steps')}, {amount(found, 'seconds')}")
        print("| " + " | ".join(cells) + " |")
        seeds = ", ".join("/".join(f"{x:.1f}" for x in end.errors) for end in ends)
        each_seed.append(f"- {algorithm}: {seeds}")
    print("\n" + "\n".join(each_seed))


@styled
def draw(rows: list[Row], path: Path) -> None:
    """Draw the mean error over the paces, a line for each seed and a thick one for the median."""
    names = [name for name in CALLS if any(row.algorithm == name for row in rows)]
    figure = Figure(figsize=(WIDTH, 3.6))
    kinds = {"steps": "environment steps", "seconds": "seconds of a core"}
    for axes, (kind, unit) in zip(figure.subplots(1, 2, sharey=True), kinds.items(), strict=True):
        for name, colour in zip(names, COLOURS, strict=False):
            own = [
                row
                for row in rows
                if (row.algorithm, row.episodes) == (name, HELD_OUT) and row.steps
            ]
            runs = [[row for row in own if row.seed == seed] for seed in {row.seed for row in own}]
            amounts = [[getattr(row, kind) for row in run] for run in runs]
            errors = [[float(np.mean(row.errors)) for row in run] for run in runs]
            for xs, ys in zip(amounts, errors, strict=True):
                axes.plot(xs, ys, color=colour, linewidth=0.6, alpha=0.5)
            shortest = min(map(len, runs))
            x, y = (np.median([e[:shortest] for e in all_], axis=0) for all_ in (amounts, errors))
            axes.plot(x, y, color=colour, linewidth=2.0, label=name)
        axes.set(xscale="log", yscale="log")
        plain_ticks(axes, "y")
        label(axes, unit, "mean path error [mm]" if kind == "steps" else "")
    figure.axes[0].legend(fontsize=7.5)
    path.write_bytes(png(figure))


def study(
    algorithms: tuple[str, ...] = ("PPO", "A2C", "TRPO", "SAC", "TQC", "CrossQ", "TD3"),
    seeds: tuple[int, ...] = (1,),
    steps: int | None = None,
    assessments: int = 20,
    fresh: int = 0,
    out: Path = Path("curves.csv"),
    picture: Path | None = None,
) -> None:
    torch.set_num_threads(1)
    known = {(row.algorithm, row.seed) for row in read(out)}
    for seed in seeds:
        for algorithm in algorithms:
            if (algorithm, seed) not in known:
                append(out, train(algorithm, seed, steps, assessments, fresh))
    rows = [row for row in read(out) if row.algorithm in algorithms]
    print_table(rows)
    if picture is not None:
        draw(rows, picture)


if __name__ == "__main__":
    tyro.cli(study)
