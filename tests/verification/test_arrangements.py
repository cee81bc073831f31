"""Machines of other clutches than the paper's: friction for any W, whole episodes, laws, and what
is refused.

Tolerances of velocities are those of tests/verification/test_friction.py: the momentum in a sector
or along a line is off by at most eight roundings, those of products with a ratio included, of
numbers up to P = |p| + Σ c·|W_x|. So

    |δω| ≤ ROUNDINGS · u · (‖M⁻¹‖ P + κ |ω|)       with a ROUNDINGS of eight.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings, strategies as st

import rollouts
from compiled_friction import resolve_arranged, resolve_friction, share_arranged
from oracle.arrangements import Arranged, problems, share, solve
from pter_gym import initial_state, simulate
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym._physics.friction import COUPLING, ClutchMode
from pter_gym.controllers import Impedance, Locked, Random, SingleDof, TorqueFeedback, VelocityRatio
from pter_gym.errors import ParameterError
from pter_gym.params import (
    ARRANGEMENTS,
    BASELINE,
    MACHINES,
    PAPER_CLUTCHES,
    SLOTS,
    Connection,
    Hand,
    Machine,
    find_machine,
)
from pter_gym.params._named import nominal_machine
from pter_gym.policies import read_policy
from pter_gym.tasks.path_following import COLUMN, PathFollowing

UNIT = 2.0**-53
ROUNDINGS = 8
COUPLING_ALONE = replace(BASELINE, clutches=(Connection("A to B", (1.0, -1.0)),))
FOUR_COUPLINGS = tuple(Connection(str(b), (1.0, b)) for b in (-2.0, -0.5, 0.5, 3.0))
DECLARED = {name: MACHINES[name] for name in ARRANGEMENTS} | {
    "one brake": replace(BASELINE, clutches=PAPER_CLUTCHES[1:2]),
    "one coupling": COUPLING_ALONE,
    "four couplings": replace(BASELINE, clutches=FOUR_COUPLINGS),
    "light hand": replace(
        MACHINES["couplings-2-1"],
        clutch_scale=(0.0, 1.0, 0.4, 1.5),
        hand=Hand(mass=1.5, damping=20.0),
    ),
    "dry axes": replace(MACHINES["two-brakes"], arm=replace(BASELINE.arm, dry_a=1.0, dry_b=0.4)),
    "dry axes without brakes": replace(
        COUPLING_ALONE, arm=replace(BASELINE.arm, dry_a=0.5, dry_b=1.0)
    ),
}


@pytest.fixture(scope="module")
def given_problems() -> Arranged:
    return problems(np.random.default_rng(20261125), 10_000)


def rounding(given: Arranged, omega: np.ndarray) -> np.ndarray:
    """The derived bound on the error of a velocity, (n,)."""
    compliance = given.trace / given.determinant
    return ROUNDINGS * UNIT * compliance * (given.momentum + given.trace * np.hypot(*omega.T))


def test_velocities_are_those_of_the_dual_for_any_rows(given_problems: Arranged) -> None:
    given = given_problems
    omega, expected = resolve_arranged(given.mass, given.p, given.c, given.w), solve(given)
    error = np.hypot(*(omega - expected).T).astype(float)
    assert np.all(error <= rounding(given, omega))

    slip = np.einsum("nxi,ni->nx", given.w, expected)
    stuck = np.abs(slip) <= 1e-15 * np.abs(given.w).sum(axis=2) * np.hypot(*expected.T)[:, None]
    found = given.w[..., 0] * omega[:, :1] + given.w[..., 1] * omega[:, 1:] == 0.0
    # others lie where the mode changes, to rounding
    assert np.mean((stuck == found).all(axis=1)) > 0.999
    assert np.mean(found.any(axis=1)) > 0.5
    assert np.mean(found.all(axis=1)) > 0.1


def test_with_the_papers_rows_velocities_are_the_papers() -> None:
    given = problems(np.random.default_rng(7), 3_000)
    given = replace(
        given,
        w=np.tile(np.array(COUPLING), (3_000, 1, 1)),
        c=np.random.default_rng(8).random((3_000, 4)),
    )
    omega = resolve_arranged(given.mass, given.p, given.c, given.w)
    rows = np.concatenate([given.mass, given.p, given.c], axis=1)
    published = np.array([resolve_friction(*row)[:2] for row in rows.tolist()])
    assert np.all(np.hypot(*(omega - published).T) <= 2.0 * rounding(given, omega))
    assert np.array_equal(omega == 0.0, published == 0.0)


def test_a_load_is_shared_with_the_smallest_torques_for_any_rows() -> None:
    """Rows that differ by 1 % lose four digits; the oracle is as good as its 1e-11 of loads and
    ranges."""
    rng = np.random.default_rng(3)
    given = problems(rng, 4_000)
    low, high = -given.c, given.c.copy()
    slipping = (rng.random((4_000, 4)) < 0.3) & (rng.random((4_000, 1)) < 0.5)
    low[slipping] = high[slipping] = (given.c * rng.choice([-1.0, 1.0], (4_000, 4)))[slipping]
    corner = np.where(rng.random((4_000, 4)) < 0.5, low, high)
    inside = np.where(
        rng.random((4_000, 1)) < 0.3, corner, low + (high - low) * rng.random((4_000, 4))
    )
    load = np.einsum("nx,nxi->ni", inside, given.w)
    mine = share_arranged(load, low, high, given.w)
    scale = (np.abs(load).sum(axis=1) + (high - low).sum(axis=1))[:, None]
    assert np.all((low <= mine) & (mine <= high))
    assert np.all(np.abs(np.einsum("nx,nxi->ni", mine, given.w) - load) <= 1e-10 * scale)
    assert np.all(np.abs(mine - share(load, low, high, given.w)) <= 1e-10 * scale)


# --- motion ---


def storm(machine: Machine, seed: int, steps: int = 400) -> Any:
    """A trajectory under voltages and loads that jump."""
    rng = np.random.default_rng([41, seed])
    volts = np.repeat(
        rng.uniform(0.0, 12.0, (steps // 20, 4)) * rng.integers(0, 2, (steps // 20, 4)), 20, axis=0
    )
    start = initial_state(machine, rng.uniform(-3.0, 3.0, 2), rng.normal(0.0, 0.5, 2), volts[0])
    force, torque = rng.normal(0.0, 40.0, (steps, 2)), rng.normal(0.0, 15.0, (steps, 2))
    return simulate(machine, start, volts, force, torque)


@pytest.mark.long
@pytest.mark.parametrize("name", DECLARED)
def test_motion_is_passive_and_its_energy_closes(name: str) -> None:
    check_motion(DECLARED[name], 4, 400)


def check_motion(machine: Machine, seeds: int, steps: int) -> None:
    rows = np.array(machine.slot_rows)
    there = np.array(machine.slot_scale) > 0.0
    for seed in range(seeds):
        run = storm(machine, seed, steps)
        told = run.hand_work - run.dissipated - run.numerical_loss + run.residual
        terms = (
            run.kinetic_energy,
            run.hand_work,
            run.dissipated,
            run.numerical_loss,
            run.residual,
        )
        sizes = np.max([np.abs(each) for each in terms], axis=0)
        sizes = np.maximum(sizes[1:], run.kinetic_energy[:-1])
        assert np.all(np.abs(np.diff(run.kinetic_energy) - told[1:]) <= 1e-12 * sizes)
        assert run.power.max() <= 0.0
        assert run.dissipated.min() >= 0.0
        assert run.numerical_loss.min() >= 0.0
        assert not run.torque[:, ~there].any()
        assert np.array_equal(
            run.slip_velocity, run.omega[:, :1] * rows[:, 0] + run.omega[:, 1:] * rows[:, 1]
        )
        stuck = run.slip_velocity[:, : len(machine.clutches)] == 0.0
        rest = ~run.omega.any(axis=1)
        first = np.where(stuck.any(axis=1), 1 + np.argmax(stuck, axis=1), ClutchMode.TWO_DOF)
        assert np.array_equal(run.mode, np.where(rest, ClutchMode.ZERO_DOF, first))


@pytest.mark.long
def test_clutches_of_any_ratio_do_stick() -> None:
    modes = np.concatenate([storm(MACHINES["couplings-1-2"], seed).mode for seed in range(4)])
    assert {*ClutchMode} == {*modes}


@pytest.mark.long
def test_two_equal_clutches_are_one_of_twice_the_torque() -> None:
    """Sums of two torques are rounded once more; the velocities of 60 substeps grow apart by far
    less than 1e-9."""
    for seed in range(4):
        rng = np.random.default_rng([41, seed])
        levels = rng.uniform(0.0, 12.0, (3, 4)) * rng.integers(0, 2, (3, 4))
        volts = np.repeat(np.concatenate([levels[:, :2], levels[:, :2]], axis=1), 20, axis=0)
        start = initial_state(MACHINES["double-brakes"], (0.5, 2.0), (0.3, -0.4), volts[0])
        twice = replace(MACHINES["two-brakes"], clutch_scale=(2.0, 2.0, 0.0, 0.0))
        force = rng.normal(0.0, 40.0, (60, 2))
        double = simulate(MACHINES["double-brakes"], start, volts, force)
        one = simulate(twice, initial_state(twice, (0.5, 2.0), (0.3, -0.4), volts[0]), volts, force)
        assert np.allclose(double.omega, one.omega, rtol=0.0, atol=1e-9)
        assert np.allclose(
            double.torque[:, :2] + double.torque[:, 2:], one.torque[:, :2], rtol=0.0, atol=1e-6
        )
        assert np.array_equal(double.mode, one.mode)


@pytest.mark.long
def test_dry_friction_holds_an_axis_without_a_clutch() -> None:
    machine = DECLARED["dry axes without brakes"]
    start = initial_state(machine, (0.5, 2.0))
    held = simulate(machine, start, np.zeros(4), np.zeros(2), (0.49, -0.99), duration=0.2)
    assert not held.omega.any()
    assert not held.torque.any()
    assert (
        simulate(machine, start, np.zeros(4), np.zeros(2), (0.51, 0.0), duration=0.2).omega[-1, 0]
        > 0.0
    )


@pytest.mark.long
@pytest.mark.parametrize("name", DECLARED)
def test_worlds_move_as_in_open_loop_and_alone_as_in_a_batch(name: str) -> None:
    """Episodes with random voltages: passive, and no world knows the others."""
    check_worlds(DECLARED[name], 9, 60)


def check_worlds(machine: Machine, count: int, steps: int) -> None:
    batch, alone = Batch(machine, PathFollowing(), count), Batch(machine, PathFollowing(), 1)
    batch.reset([*range(count)])
    alone.reset([count // 2])
    rng = np.random.default_rng(5)
    for _ in range(steps):
        actions = rng.uniform(0.0, 24.0, (count, 4)) * rng.integers(0, 2, (count, 4))
        actions = actions[:, : batch.num_actions]
        told = batch.step(actions, SKIP)
        mine = actions[count // 2]
        other = alone.step(mine[None], SKIP)
        rows = told.telemetry[0]
        power, dissipated = rows[:, [*COLUMN.power]], rows[:, COLUMN.energy.dissipated]
        assert not (power > 0.0).any()
        assert not (dissipated < 0.0).any()
        moved = [*COLUMN.theta, *COLUMN.tip_velocity, *COLUMN.torque]
        assert np.array_equal(rows[count // 2, moved], other.telemetry[0, 0, moved], equal_nan=True)


@pytest.mark.long
def test_a_strong_coupling_leaves_a_world_the_line_of_its_own_ratio() -> None:
    check_lines()


def check_lines() -> None:
    """Two of the four couplings are stuck after eight steps, the arm moves on."""
    for slot in (0, 3):
        batch = Batch(DECLARED["four couplings"], PathFollowing(), 1)
        batch.reset([1])
        for _ in range(8):
            row = batch.step(24.0 * np.eye(4)[slot : slot + 1], SKIP).telemetry[0, 0]
        assert row[COLUMN.mode] == 1 + slot
        assert row[[*COLUMN.tip_velocity]].any()


# --- environments and laws ---


@pytest.mark.long
@pytest.mark.parametrize("count", [2, 3])
def test_environments_take_an_entry_for_each_clutch(count: int) -> None:
    name = {2: "two-brakes", 3: "brakes-and-coupling"}[count]
    env: Any = gymnasium.make("PTER/PathFollowing-v0", machine=name, max_episode_steps=40)
    check_env(env.unwrapped, skip_render_check=True)
    envs = gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=3, machine=name)
    envs.reset(seed=5)
    env.reset(seed=5)
    action = np.linspace(0.2, 0.5, count, dtype=np.float32)
    obs, _, _, _, info = env.step(action)
    np.testing.assert_array_equal(envs.step(np.tile(action, (3, 1)))[0][0], obs)
    volts = [24.0 * (0.5 * (entry + 1.0)) ** 2 for entry in action]
    told = info["telemetry"][[*COLUMN.volts]]
    assert told == pytest.approx([*volts, *[0.0] * (SLOTS - count)])


@pytest.mark.long
@pytest.mark.agents
def test_stable_baselines3_steps_as_the_vector_environment() -> None:
    door = pytest.importorskip("pter_gym.envs.sb3", exc_type=ImportError)
    worlds = door.make_sb3_vec_env(3, machine="two-brakes")
    envs = gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=3, machine="two-brakes")
    worlds.seed(5)
    np.testing.assert_array_equal(worlds.reset(), envs.reset(seed=5)[0])
    actions = np.full((3, 2), -0.4, np.float32)
    np.testing.assert_array_equal(worlds.step(actions)[0], envs.step(actions)[0])


@pytest.mark.long
@pytest.mark.parametrize("name", DECLARED)
@pytest.mark.parametrize(
    "law", [Impedance(), TorqueFeedback(), SingleDof(), VelocityRatio(), Locked(), Random()]
)
def test_laws_command_only_what_is_there(name: str, law: Any) -> None:
    check_law(DECLARED[name], law, 4, 150)


def check_law(machine: Machine, law: Any, count: int, steps: int) -> None:
    batch = Batch(machine, PathFollowing(), count)
    rows = rollouts.simulate(batch, law, [*range(count)], steps, machine)
    volts = rows[..., [*COLUMN.volts]]
    there = np.array(machine.slot_scale) > 0.0
    assert not np.nan_to_num(volts[..., ~there]).any()
    assert np.nan_to_num(volts[..., there]).any()


@pytest.mark.long
def test_single_dof_lines_engage_a_coupling_of_any_ratio() -> None:
    machine = replace(BASELINE, clutches=FOUR_COUPLINGS)
    batch = Batch(machine, PathFollowing(), 16)
    rows = rollouts.simulate(batch, SingleDof(), [*range(16)], 200, machine)
    assert np.nan_to_num(rows[..., [*COLUMN.volts]]).max(axis=(0, 1)).astype(bool).sum() >= 2


WITHOUT_KERNELS = """
from verification.test_arrangements import *

for machine in DECLARED.values():
    check_motion(machine, 1, 60)
for name in ("couplings-1-2", "light hand", "dry axes without brakes"):
    check_worlds(DECLARED[name], 2, 3)
    check_law(DECLARED[name], SingleDof(), 1, 6)
check_lines()
"""


def test_the_functions_of_the_kernels_do_the_same() -> None:
    """Few steps of those tests above that are long: the kernels take half a minute to compile."""
    environment = {
        **os.environ,
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": os.pathsep.join(
            [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        ),
    }
    subprocess.run([sys.executable, "-c", WITHOUT_KERNELS], env=environment, check=True)


# --- declarations ---


@settings(derandomize=True, deadline=None, database=None, max_examples=200)
@given(st.tuples(st.floats(), st.floats()))
def test_a_row_is_a_brake_or_a_coupling(row: tuple[float, float]) -> None:
    a, b = row
    if (a, b) == (0.0, 1.0) or (a == 1.0 and (b == 0.0 or 0.01 <= abs(b) <= 100.0)):
        assert Connection("x", row).row == row
    else:
        with pytest.raises(ParameterError, match=r"Connection\.row"):
            Connection("x", row)


def of_rows(*rows: tuple[float, float]) -> Machine:
    return replace(BASELINE, clutches=tuple(Connection(str(x), row) for x, row in enumerate(rows)))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: replace(BASELINE, clutches=()), r"Machine\.clutches"),
        (lambda: replace(BASELINE, clutches=("brake",)), r"Machine\.clutches"),
        (lambda: of_rows(*[(1.0, 0.5 * x) for x in range(1, 6)]), r"Machine\.clutches"),
        (lambda: replace(BASELINE, clutches=PAPER_CLUTCHES[:1] * 2), r"Machine\.clutches"),
        (lambda: of_rows(*[(1.0, 2.0)] * 4), r"Machine\.clutches"),
        (lambda: of_rows((1.0, 2.0), (1.0, 2.01)), r"Machine\.clutches"),
        (lambda: of_rows((0.0, 0.0)), r"Connection\.row"),
        (lambda: of_rows((1.0, float("nan"))), r"Connection\.row"),
        (lambda: Connection("", (1.0, 0.0)), r"Connection\.name"),
        (
            lambda: replace(
                BASELINE, clutches=FOUR_COUPLINGS, arm=replace(BASELINE.arm, dry_b=1.0)
            ),
            r"Arm\.dry_b",
        ),
        (lambda: find_machine("two-breaks"), "'two-brakes'"),
    ],
)
def test_bad_declarations_are_refused(made: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        made()


def test_machines_that_were_never_built_are_known_by_name() -> None:
    for name, clutches in ARRANGEMENTS.items():
        assert find_machine(name) == replace(BASELINE, clutches=clutches)
        assert not find_machine(name).has_paper_clutches


@pytest.mark.parametrize(
    "made",
    [
        lambda: Batch([BASELINE, MACHINES["two-brakes"]], PathFollowing()),
        lambda: read_policy("ppo-standard").bind(
            MACHINES["two-brakes"], Batch(BASELINE, PathFollowing(), 1).layout
        ),
        lambda: nominal_machine({MACHINES["two-brakes"], MACHINES["couplings-1-2"]}),
    ],
    ids=["with the paper's in a batch", "a policy trained on the paper's", "several nominal ones"],
)
def test_mismatched_clutches_are_refused(made: Any) -> None:
    with pytest.raises(ParameterError, match=r"Machine\.clutches"):
        made()


@pytest.mark.long
def test_worlds_of_different_clutches_share_a_batch() -> None:
    several = [MACHINES["double-brakes"], MACHINES["couplings-1-2"], MACHINES["couplings-2-1"]]
    together = Batch(several, PathFollowing())
    together.reset([0, 1, 2])
    alone = [Batch(machine, PathFollowing(), 1) for machine in several]
    for seed, batch in enumerate(alone):
        batch.reset([seed])
    for k in range(30):
        actions = np.full((3, 4), float(k % 12))
        rows = together.step(actions, SKIP).telemetry[0]
        for x, batch in enumerate(alone):
            own = batch.step(actions[:1], SKIP).telemetry[0, 0]
            same = np.delete(own, COLUMN.context), np.delete(rows[x], COLUMN.context)
            assert np.array_equal(*same, equal_nan=True)
