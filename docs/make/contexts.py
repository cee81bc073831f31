"""Which part of machine, hand and path makes a policy good or bad: `python docs/make/contexts.py`, into docs/agents.md.

    python docs/make/contexts.py --policy residual --scenario everything --draws 1000

The policy runs on training draws of a seed that no training has. For each part of the context the draws are put into
groups: one for each kind, or thirds of equal size by a number. What a part explains is the share of the variance of a
score that lies between its groups; errors count by their ranks, since a few are large.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from pages import AGENTS, put_block, signed
from scipy.stats import rankdata, spearmanr

from pter_gym.benchmark import PACES, find_policy
from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.evaluation import Batches, evaluate
from pter_gym.hands import EQ5_FREQUENCIES, NORMAL, RELAXED, TENSE, HumanArm
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Machine
from pter_gym.policies import load_policy
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import PathFollowing

SEED = 2**31 + 2
FIRST_RESET = 2**41

ARMS = {"relaxed arm": RELAXED, "normal arm": NORMAL, "tense arm": TENSE}
MATERIALS = {"present": BASELINE, "Delrin, measured": DELRIN_EXPERIMENTAL, "Delrin, literature": DELRIN_THEORETICAL}

SHOWN = 2.0
"""Smallest share that a part explains [%], on average over the paces, for its groups to be shown."""

Array = NDArray[np.float64]
Scores = Mapping[str, NDArray[Any]]


class Column(NamedTuple):
    """A score: its title, its name in `Score`, a factor, and whether ranks count in its place."""

    name: str
    score: str
    factor: float
    by_rank: bool

    def of(self, scores: Scores) -> Array:
        """The score of each draw."""
        return self.factor * scores[self.score].astype(np.float64)


COLUMNS = (
    Column("Path error [mm]", "path_error_m", 1000.0, True),
    Column("Arrives [%]", "completed", 100.0, False),
    Column("Segments off the pace [%]", "segment_pace_error", 100.0, True),
)


def hand_kind(task: PathFollowing) -> str:
    """The kind of hand in words."""
    hand = task.hand
    if isinstance(hand, HumanArm):
        return next(name for name, impedance in ARMS.items() if hand.impedance == impedance)
    return "the paper's sines" if hand.frequencies == EQ5_FREQUENCIES else "other sines"


def material(machine: Machine) -> str:
    """The clutches' material."""
    clutch = replace(machine.clutch, time_constant=BASELINE.clutch.time_constant)
    return next(name for name, each in MATERIALS.items() if each.clutch == clutch)


FACTORS: dict[str, Callable[[Machine, PathFollowing], str | float]] = {
    "path": lambda _, task: type(task.path).__name__.lower(),
    "hand": lambda _, task: hand_kind(task),
    "clutch material": lambda machine, _: material(machine),
    "sensor delay [steps]": lambda _, task: f"{task.sensing.delay:g}",
    "time constant [s]": lambda machine, _: machine.clutch.time_constant,
    "clutch torque, mean factor": lambda machine, _: float(np.mean(machine.clutch_scale)),
    "clutch torque, largest over smallest": lambda machine, _: max(machine.clutch_scale) / min(machine.clutch_scale),
    "drift of the torque [1/s]": lambda _, task: task.friction_drift,
    "inertia A [kg·m²]": lambda machine, _: machine.arm.inertia_a,
    "inertia B [kg·m²]": lambda machine, _: machine.arm.inertia_b,
    "path length [m]": lambda _, task: task.path.length,
    "largest curvature [1/m]": lambda _, task: task.path.max_curvature,
    "velocity noise [rad/s]": lambda _, task: task.sensing.velocity_noise,
    "torque noise [N·m]": lambda _, task: task.sensing.torque_noise,
    "encoder resolution [mrad]": lambda _, task: f"{1000 * task.sensing.angle_resolution:.2g}",
}


def run(name: str, folder: Path | None, scenario: str, pace: str, draws: int) -> tuple[Episodes, Scores]:
    """The draws at a pace and the scores of a policy on them."""
    pairs = find_scenario(scenario).randomisation(pace, contexts=draws, seed=SEED).pairs()
    machines, tasks = zip(*pairs, strict=True)
    resets = tuple(range(FIRST_RESET, FIRST_RESET + draws))
    episodes = Episodes(scenario, "", machines, tasks, resets, ("drawn",) * draws)
    policy = find_policy(name, scenario=scenario) if folder is None else load_policy(name, folder)
    batches = Batches(episodes)
    return episodes, evaluate(batches.bind(policy), batches, 1)[0]


def groups(values: list[str | float]) -> dict[str, NDArray[np.bool_]]:
    """Which draws belong together: one group for each kind, or thirds by a number."""
    if isinstance(values[0], str):
        kinds = np.array(values)
        return {kind: kinds == kind for kind in sorted(set(values))}
    numbers = np.array(values, np.float64)
    if np.ptp(numbers) == 0.0:
        return {"": np.ones(len(numbers), np.bool_)}
    edges = np.quantile(numbers, (0.0, 1 / 3, 2 / 3, 1.0))
    third = np.clip(np.searchsorted(edges[1:3], numbers, side="right"), 0, 2)
    return {signed(f"{edges[k]:.3g} to {edges[k + 1]:.3g}"): third == k for k in range(3) if (third == k).any()}


def explained(values: Array, members: Mapping[str, NDArray[np.bool_]]) -> float:
    """The share of the variance that lies between groups; 0 where nothing varies."""
    total = float(((values - values.mean()) ** 2).sum())
    between = sum(own.sum() * (values[own].mean() - values.mean()) ** 2 for own in members.values())
    return float(between) / total if total > 0.0 else 0.0


def three(numbers: list[float], digits: int) -> str:
    """One number for each pace."""
    return ", ".join(f"{number:.{digits}f}" for number in numbers)


class Part(NamedTuple):
    """How a part of the context matters.

    Attributes
    ----------
    explained
        In percent, for each of `COLUMNS` at each pace.
    text
        Its lines of the table.
    """

    explained: list[list[float]]
    text: str


def part(name: str, runs: list[tuple[Episodes, Scores]]) -> Part | None:
    """What a part of the context explains; None if it does not vary."""
    of_each_pace = [
        [FACTORS[name](machine, task) for machine, task in zip(episodes.machines, episodes.tasks, strict=True)]
        for episodes, _ in runs
    ]
    values = of_each_pace[0]
    assert all(each == values for each in of_each_pace), "the draws differ in the pace alone"
    members = groups(values)
    if len(members) < 2:
        return None
    columns = [[each.of(scores) for _, scores in runs] for each in COLUMNS]
    shares = [
        [100.0 * explained(rankdata(at) if column.by_rank else at, members) for at in found]
        for column, found in zip(COLUMNS, columns, strict=True)
    ]
    percent = cells([f"{three(each, 0)} %" for each in shares])
    text = f"| **{name}**{correlation(values, columns[0])} | explains | {percent}"
    if np.mean(shares, axis=1).max() >= SHOWN:
        for group, own in members.items():
            means = [three([float(at[own].mean()) for at in found], 1) for found in columns]
            text += f"| {group} | {own.sum()} | {cells(means)}"
    return Part(shares, text)


def cells(texts: list[str]) -> str:
    """The rest of a line of the table."""
    return " | ".join(texts) + " |\n"


def correlation(values: list[str | float], errors: list[Array]) -> str:
    """The rank correlation of a number with the path error, in words."""
    if isinstance(values[0], str):
        return ""
    found = [float(spearmanr(values, each).statistic) for each in errors]
    return signed(f", rank correlation {np.mean(found):+z.2f}")


def main(
    policy: str = "residual",
    policies: Path | None = None,
    scenario: str = "everything",
    draws: int = 1000,
    write: bool = True,
) -> None:
    """Score a policy, shipped or in the folder `policies`, and write the table into the page, or print it."""
    runs = [run(policy, policies, scenario, pace, draws) for pace in PACES]
    means = [three([float(each.of(scores).mean()) for _, scores in runs], 1) for each in COLUMNS]
    head = (
        f"`{policy}` on {draws} training draws of `{scenario}`, seed {SEED}; means at slow, medium and brisk pace. "
        f"What explains most comes first; thirds explain {100.0 * 2 / (draws - 1):.1f} % by chance. Parts that "
        f"explain less than {SHOWN:g} % of each score have no groups here."
    )
    text = (
        f"{fill(head, 120)}\n\n| Part | Draws | {cells([each.name for each in COLUMNS])}"
        f"|---|---:|{'---|' * len(COLUMNS)}\n| all | {draws} | {cells(means)}"
    )
    found = [each for each in (part(name, runs) for name in FACTORS) if each is not None]
    for each in sorted(found, key=lambda each: -float(np.sum(each.explained))):
        text += each.text
    put_block(AGENTS, "contexts", text, write=write)


if __name__ == "__main__":
    tyro.cli(main)
