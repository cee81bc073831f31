"""Which part of machine, hand and path makes a policy good or bad: `python docs/make/contexts.py`, into docs/agents.md.

    python docs/make/contexts.py --policy residual --scenario everything --draws 1000

The policy runs on training draws of a seed that no training has. For each part of the context the draws are put into
groups: one for each kind, or thirds of equal size by a number. What a part explains is the share of the variance of a
score that lies between its groups; errors count by their ranks, since a few are large.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from pages import put_block, signed
from scipy.stats import rankdata, spearmanr

from pter_gym.benchmark import PACES, find_policy
from pter_gym.benchmark._evaluation import Batches, bind_once, evaluate
from pter_gym.benchmark.episodes import Episodes
from pter_gym.hands import EQ5_FREQUENCIES, NORMAL, RELAXED, TENSE, HumanArm
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Machine
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
Groups = Mapping[str, NDArray[np.bool_]]


class Column(NamedTuple):
    """A score: its title, its name in `Score`, a factor, and whether its ranks count in its place."""

    title: str
    score: str
    factor: float
    by_rank: bool

    def of(self, scores: Scores) -> Array:
        """Return the score of each draw."""
        return self.factor * scores[self.score].astype(np.float64)

    def explained(self, values: Array, members: Groups) -> float:
        """Return the share of the variance that lies between groups [%]; 0 where nothing varies."""
        found = rankdata(values) if self.by_rank else values
        total = float(((found - found.mean()) ** 2).sum())
        between = sum(own.sum() * (found[own].mean() - found.mean()) ** 2 for own in members.values())
        return 100.0 * float(between) / total if total > 0.0 else 0.0


COLUMNS = (
    Column("Path error [mm]", "path_error_m", 1000.0, by_rank=True),
    Column("Arrives [%]", "completed", 100.0, by_rank=False),
    Column("Segment pace error [%]", "segment_pace_error", 100.0, by_rank=True),
)


def hand_kind(task: PathFollowing) -> str:
    """Return the kind of hand in words."""
    hand = task.hand
    if isinstance(hand, HumanArm):
        return next(name for name, impedance in ARMS.items() if hand.impedance == impedance)
    return "the paper's sines" if hand.frequencies == EQ5_FREQUENCIES else "other sines"


def material(machine: Machine) -> str:
    """Return the clutches' material."""
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


def run(policy: str, scenario: str, pace: str, draws: int) -> tuple[Episodes, Scores]:
    """Return the draws at a pace and the scores of a policy on them."""
    pairs = find_scenario(scenario).randomisation(pace, contexts=draws, seed=SEED).pairs()
    machines, tasks = zip(*pairs, strict=True)
    resets = tuple(range(FIRST_RESET, FIRST_RESET + draws))
    batches = Batches(Episodes(scenario, "", machines, tasks, resets, ("drawn",) * draws))
    return batches.episodes, evaluate(bind_once(find_policy(policy, scenario=scenario)), batches, 1)[0]


def groups(values: list[str] | list[float]) -> Groups:
    """Return which draws belong together: one group for each kind, or thirds by a number."""
    if isinstance(values[0], str):
        kinds = np.array(values)
        return {kind: kinds == kind for kind in sorted(set(values))}
    numbers = np.array(values, np.float64)
    if np.ptp(numbers) == 0.0:
        return {}
    edges = np.quantile(numbers, (0.0, 1 / 3, 2 / 3, 1.0))
    third = np.clip(np.searchsorted(edges[1:3], numbers, side="right"), 0, 2)
    return {signed(f"{edges[k]:.3g} to {edges[k + 1]:.3g}"): third == k for k in range(3) if (third == k).any()}


def cells(columns: list[list[float]], digits: int, unit: str = "") -> str:
    """Return the end of a line: a cell for each column, one number in it for each pace."""
    return " | ".join(", ".join(f"{number:.{digits}f}" for number in each) + unit for each in columns) + " |\n"


def part(name: str, values: list[Any], columns: list[list[Array]]) -> tuple[float, str]:
    """Return how much a part of the context explains in all, and its lines of the table; none if it does not vary."""
    members = groups(values)
    if len(members) < 2:
        return 0.0, ""
    shares = [[each.explained(at, members) for at in found] for each, found in zip(COLUMNS, columns, strict=True)]
    told = ""
    if not isinstance(values[0], str):
        found = np.mean([spearmanr(values, errors).statistic for errors in columns[0]])
        told = signed(f", rank correlation {found:+z.2f}")
    text = f"| **{name}**{told} | explains | {cells(shares, 0, ' %')}"
    if np.mean(shares, axis=1).max() >= SHOWN:
        for group, own in members.items():
            means = [[float(at[own].mean()) for at in found] for found in columns]
            text += f"| {group} | {own.sum()} | {cells(means, 1)}"
    return float(np.sum(shares)), text


def main(policy: str = "residual", scenario: str = "everything", draws: int = 1000, write: bool = True) -> None:
    """Score a policy, and write the table into the page, or print it."""
    runs = [run(policy, scenario, pace, draws) for pace in PACES]
    episodes, _ = runs[0]  # the others differ in the pace alone
    columns = [[each.of(scores) for _, scores in runs] for each in COLUMNS]
    head = (
        f"`{policy}` on {draws} training draws of `{scenario}`, seed {SEED}; means at slow, medium and brisk pace. "
        f"What explains most comes first; thirds explain {100.0 * 2 / (draws - 1):.1f} % by chance. Parts that "
        f"explain less than {SHOWN:g} % of each score have no groups here."
    )
    titles = " | ".join(each.title for each in COLUMNS)
    means = [[float(at.mean()) for at in found] for found in columns]
    text = f"{fill(head, 120)}\n\n| Part | Draws | {titles} |\n|---|---:|{'---|' * len(COLUMNS)}\n"
    text += f"| all | {draws} | {cells(means, 1)}"
    pairs = list(zip(episodes.machines, episodes.tasks, strict=True))
    found = [part(name, [factor(*pair) for pair in pairs], columns) for name, factor in FACTORS.items()]
    text += "".join(lines for _, lines in sorted(found, key=lambda each: -each[0]))
    put_block("docs/agents.md", "contexts", text, write=write)


if __name__ == "__main__":
    tyro.cli(main)
