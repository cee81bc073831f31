"""Print the numbers of docs/development/verification.md about friction and mechanics.

Run it in the folder ``tests``: ``python -m verification.report``.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from oracle import friction as oracle
from oracle.plants import draw
from peer import test_mujoco
from pter_gym.params import BASELINE
from verification import test_friction, test_order


def friction() -> None:
    say("Friction: error over |M⁻¹p| where κ < 1e5, error over its bound, wrong modes")
    for index, problems in enumerate(test_friction.FAMILIES):
        mine, solution = test_friction.resolved(index), test_friction.expected(index)
        error = np.hypot(mine[:, 0] - solution.omega[0], mine[:, 1] - solution.omega[1]).astype(
            float
        )
        usual = (problems.condition < 1e5) & (problems.free_speed > 0.0)
        relative = (error[usual] / problems.free_speed[usual]).max()
        bound = (error / np.maximum(test_friction.rounding(problems, mine[:, :2]), 1e-300)).max()
        margin = (
            test_friction.ROUNDINGS * test_friction.UNIT * problems.condition * problems.momentum
        )
        clear = oracle.tie_distance(*problems.numbers, solution) > margin
        wrong = int((mine[clear, 2] != oracle.modes(solution.omega)[clear]).sum())
        say(
            f"  {problems.name:30s} {len(problems):6d}  {relative:.1e}  {bound:.2f}  "
            f"{wrong} of {int(clear.sum())}"
        )


def paper_rule() -> None:
    say("The paper's rule, share of states on which it agrees: of all, and of those that move")
    for kind in ("sector", "line", "rest"):
        for engaged in range(5):
            everywhere, moving = test_friction.agreement(kind, engaged)
            say(f"  {kind:7s} {engaged} engaged: {everywhere:.4f} {moving:.4f}")


def mujoco() -> None:
    cases = [test_mujoco.draw(subset, seed) for subset in range(16) for seed in test_mujoco.SEEDS]
    for name, machine in test_mujoco.MATERIALS.items():
        apart = largest(
            test_mujoco.ours(machine, case).theta - test_mujoco.peers(machine, case)
            for case in cases
        )
        say(f"MuJoCo, {len(cases)} cases, {name}: {apart:.1e} rad")


def largest(differences) -> float:
    return max(float(np.abs(difference).max()) for difference in differences)


def order() -> None:
    for name in test_order.MACHINES:
        say(
            f"Order, {name}, {len(test_order.errors(name))} scenarios, steps",
            *(f"{step:.2e}" for step in test_order.STEPS),
        )
        for mean, error in test_order.means(name).items():
            say(
                f"  {mean:9s} order {test_order.order(error):.3f}:",
                *(f"{value:.1e}" for value in error),
            )


def band(scenarios: int = 200) -> None:
    say(
        "Largest change of an angle in 1 s when δω = 1e-3 rad/s is changed, "
        f"{scenarios} scenarios, 1 ms"
    )
    before = [at_band(1e-3, seed) for seed in range(scenarios)]
    for threshold in (1e-5, 1e-4, 3e-4, 3e-3, 1e-2, 3e-2):
        change = [largest([at_band(threshold, seed) - theta]) for seed, theta in enumerate(before)]
        middle, most = np.quantile(change, [0.5, 0.9])
        say(
            f"  {threshold:.0e}: median {middle:.1e}, nine of ten below {most:.1e}, "
            f"largest {max(change):.1e} rad"
        )


def at_band(threshold: float, seed: int) -> np.ndarray:
    return test_order.ours(replace(BASELINE, slip_threshold=threshold), draw(seed), 1e-3).theta


def say(*words: str) -> None:
    sys.stdout.write(" ".join(words) + "\n")


if __name__ == "__main__":
    for part in (friction, paper_rule, mujoco, order, band):
        part()
