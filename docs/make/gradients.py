"""What a gradient through stick-slip is worth, and what it costs: docs/gradients.md. Two minutes of one core.

    python docs/make/gradients.py            prints the tables
    python docs/make/gradients.py --write    writes them and the figure

The hand pushes the tip along the x axis, with a sine across it. Voltages are drawn about `MEAN` anew for each control
step. The objective is the mean over them of a rollout's cost; its derivative by a shift of one clutch's voltages in all
control steps is found as the mean of gradients, and as the mean of paired differences with the same draws.
"""

from collections.abc import Iterator
from dataclasses import replace
from time import thread_time
from typing import Any

import numpy as np
import tyro
from matplotlib import pyplot as plt
from numpy.typing import NDArray
from pages import IMAGES, put_block, signed, table

from pter_gym import gradients, initial_state
from pter_gym._physics.open_loop import BODY_WIDTH
from pter_gym.gradients._adjoint import kernels
from pter_gym.gradients._rollout import checked
from pter_gym.params import BASELINE, Machine
from pter_gym.tools.figures import save, styled

Array = NDArray[np.float64]

PAGE = "docs/gradients.md"
SEED = 20261125
DRAWS = 1000
HORIZONS = (10, 30, 100, 200)
"""Control steps of 10 ms."""

MEAN, SPREAD, SHIFT = 12.0, 4.0, 0.05
"""Of the voltages, and of what a paired difference changes [V]."""

WIDEST = 0.9 * MEAN
"""Largest deviation of a voltage [V]: it stays within the clutches' range."""

DYNAMIC = BASELINE.clutch.dynamic
RATIOS = {
    f"{ratio:.2f}": replace(BASELINE, clutch=replace(BASELINE.clutch, breakaway=DYNAMIC.scaled(ratio)))
    for ratio in (1.0, 1.12)
}
"""Machines by their ratio of breakaway to dynamic torque."""

SPEED, HEIGHT = 0.25, 0.7809
"""The tip's speed that costs nothing [m/s], and the y of its path [m]."""


def situation(machine: Machine, steps: int) -> dict[str, Any]:
    """Return what a rollout begins with: the tip at (−0.2, HEIGHT), at SPEED along x."""
    a, b = machine.arm.length_a, machine.arm.length_b
    x, y = -0.2, HEIGHT
    bend = np.arccos((x * x + y * y - a * a - b * b) / (2.0 * a * b))
    theta_a = np.arctan2(y, x) + np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
    theta = np.array([theta_a, theta_a - bend])
    jacobian = np.array([[-a * np.sin(theta[0]), -b * np.sin(theta[1])], [a * np.cos(theta[0]), b * np.cos(theta[1])]])
    state = initial_state(machine, theta, np.linalg.solve(jacobian, [SPEED, 0.0]), (MEAN,) * 4)
    times = 0.01 * np.arange(steps)
    force = np.stack([np.full(steps, 57.67), 21.82 * np.sin(2.0 * np.pi * 0.8 * times)], axis=1)
    return {"machine": machine, "state": state, "hand_force": force}


def errors(run: gradients.Rollout) -> tuple[Array, Array]:
    """Return errors of position and speed after each control step, over 30 mm and 0.1 m/s."""
    return (run.tip_position[1:, 1] - HEIGHT) / 0.03, (run.tip_velocity[1:, 0] - SPEED) / 0.1


def costs(run: gradients.Rollout) -> Array:
    """Return the mean cost up to each horizon."""
    squares = sum(np.square(each) for each in errors(run))
    return np.array([squares[:steps].mean() for steps in HORIZONS])


def by_shift(run: gradients.Rollout, steps: int) -> Array:
    """Return the derivative of the mean cost up to a horizon by a shift of each clutch's voltages."""
    by_position, by_velocity = np.zeros_like(run.tip_position), np.zeros_like(run.tip_position)
    across, along = errors(run)
    by_position[1 : steps + 1, 1] = 2.0 * across[:steps] / 0.03 / steps
    by_velocity[1 : steps + 1, 0] = 2.0 * along[:steps] / 0.1 / steps
    return run.gradient(tip_position=by_position, tip_velocity=by_velocity).volts.sum(axis=0)


def estimates(machine: Machine) -> tuple[Array, Array, Array]:
    """Return each draw's gradient, paired difference, and zeroth-order estimate, (DRAWS, horizons, 4)."""
    rng, given = np.random.default_rng(SEED), situation(machine, max(HORIZONS))
    first, paired, zeroth = (np.empty((DRAWS, len(HORIZONS), 4)) for _ in range(3))
    for draw in range(DRAWS):
        noise = rng.normal(0.0, SPREAD, (max(HORIZONS), 4)).clip(-WIDEST, WIDEST)
        run = gradients.rollout(volts=MEAN + noise, **given)
        first[draw] = [by_shift(run, steps) for steps in HORIZONS]
        for clutch in range(4):
            shift = SHIFT * np.eye(4)[clutch]
            ends = [costs(gradients.rollout(volts=MEAN + noise + sign * shift, **given)) for sign in (1.0, -1.0)]
            paired[draw, :, clutch] = (ends[0] - ends[1]) / (2.0 * SHIFT)
        opposite = costs(gradients.rollout(volts=MEAN - noise, **given))
        sums = np.array([noise[:steps].sum(axis=0) for steps in HORIZONS]) / SPREAD**2
        zeroth[draw] = 0.5 * (costs(run) - opposite)[:, None] * sums
    return first, paired, zeroth


def biases(first: Array, paired: Array) -> Iterator[tuple[float, float]]:
    """Yield the bias of a mean gradient over the size of the paired one, and its standard error, by horizon."""
    rng = np.random.default_rng(SEED)
    for k in range(len(HORIZONS)):
        size = np.linalg.norm(paired[:, k].mean(axis=0))
        apart = first[:, k] - paired[:, k]
        drawn = [apart[rng.integers(0, DRAWS, DRAWS)].mean(axis=0) for _ in range(500)]
        yield np.linalg.norm(apart.mean(axis=0)) / size, float(np.linalg.norm(np.std(drawn, axis=0))) / size


@styled
def figure(found: dict[str, list[tuple[float, float]]]) -> Any:
    """Return the cost over a shift of one clutch's voltages with gradients as tangents, and the biases."""
    drawing, (left, right) = plt.subplots(1, 2, figsize=(7.0, 3.0))
    rng = np.random.default_rng(SEED)
    noise = rng.normal(0.0, SPREAD, (max(HORIZONS), 4)).clip(-WIDEST, WIDEST)
    shifts = np.linspace(-1.0, 1.0, 801)
    for (ratio, machine), colour in zip(RATIOS.items(), ("C0", "C1"), strict=True):
        given, clutch = situation(machine, max(HORIZONS)), np.eye(4)[3]
        runs = [gradients.rollout(volts=MEAN + noise + shift * clutch, **given) for shift in shifts]
        left.plot(shifts, [costs(run)[-1] for run in runs], colour, label=f"$T_s/T_k$ = {ratio}")
        for k in range(50, len(shifts), 140):
            ends = np.array([-0.06, 0.06])
            slope = by_shift(runs[k], HORIZONS[-1])[3]
            left.plot(shifts[k] + ends, costs(runs[k])[-1] + slope * ends, "k", linewidth=1.6)
        shares = np.array(found[ratio])
        right.errorbar(HORIZONS, 100.0 * shares[:, 0], 200.0 * shares[:, 1], fmt="o-", color=colour, capsize=3)
    left.set(xlabel="shift of clutch 4's voltages [V]", ylabel="cost of one rollout of 2 s [1]")
    right.set(xlabel="control steps [1]", ylabel="bias of the mean gradient [%]", xscale="log")
    right.set_xticks(HORIZONS, [f"{steps}" for steps in HORIZONS])
    left.legend()
    return drawing


def speed(pairs: int = 200) -> str:
    """Return what a gradient costs, as a table: medians of the ratios of pairs, processor time of one thread."""
    rows: list[list[str]] = []
    for name, machine in RATIOS.items():
        given = situation(machine, 200)
        rng = np.random.default_rng(SEED)
        inputs = checked(
            volts=rng.normal(MEAN, SPREAD, (200, 4)).clip(0.0, 24.0), hand_target=None, period=0.01, **given
        )
        states: Any = np.empty((201, 20))
        arrays = inputs.body, inputs.volts, inputs.hand_force, inputs.hand_target, inputs.machine.substep, states
        results = [np.empty_like(each) for each in (states, *arrays[1:4])]
        results[0][:] = rng.normal(size=states.shape)
        bar = np.empty((BODY_WIDTH, 1))
        forward, backward = kernels(papers=True)
        ratios: list[float] = []
        for _ in range(pairs):
            begin = thread_time()
            forward(*arrays)
            middle = thread_time()
            backward(*arrays, *results, bar)
            ratios.append((thread_time() - begin) / (middle - begin))
        low, median, high = np.quantile(ratios, (0.1, 0.5, 0.9))
        rows.append([name, f"{median:.1f}", f"{low:.1f} to {high:.1f}"])
    return table(("T_s/T_k", "rollout and gradient, over rollout", "middle 80 % of pairs"), rows)


def main(*, write: bool = False) -> None:
    found: dict[str, list[tuple[float, float]]] = {}
    rows: list[list[str]] = []
    for name, machine in RATIOS.items():
        first, paired, zeroth = estimates(machine)
        found[name] = [*biases(first, paired)]
        for k, steps in enumerate(HORIZONS):
            share, error = found[name][k]
            quieter = float(np.mean(zeroth[:, k].var(axis=0) / first[:, k].var(axis=0)))
            same = int(np.sum(np.sign(first[:, k].mean(axis=0)) == np.sign(paired[:, k].mean(axis=0))))
            rows.append(
                [f"{name}, {steps}", signed(f"{100 * share:.2g} ± {200 * error:.1g}"), f"{same} of 4", f"{quieter:.2g}"]
            )
    header = ("T_s/T_k, control steps", "bias [%]", "same sign", "variance of zeroth order over it")
    put_block(PAGE, "bias", table(header, rows), write=write)
    put_block(PAGE, "cost", speed(), write=write)
    if write:
        save(figure(found), IMAGES / "gradients.png")


if __name__ == "__main__":
    tyro.cli(main)
