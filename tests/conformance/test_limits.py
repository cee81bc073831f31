"""What the integrator cannot hold is refused or ends the episode; copies of batches go on."""

import copy
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import FLAG, ROW, SAME_STEP
from pter_gym._physics.arm import Linkage
from pter_gym._physics.model import model_of
from pter_gym._physics.stability import (
    MAX_TURN,
    condition,
    largest_energy,
    largest_force,
    largest_motion,
    largest_travel,
    smallest_inertia,
)
from pter_gym.envs import PathFollowingVectorEnv
from pter_gym.errors import ParameterError
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces
from pter_gym.params import BASELINE, MACHINES, Arm, Hand, Machine
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import PathFollowing, Reason, Starts, check_machine, reason_of
from pter_gym.tasks.path_following._specification import check_motion, held_machine, strongest


def ended(max_steps: int) -> tuple[int, bool, bool]:
    """When and how an episode ends that no clutch slows down."""
    fields = {"frame_skip": 1, "contexts": 1, "max_episode_steps": max_steps}
    env = PathFollowingVectorEnv(1, scenario="standard", **fields)
    env.reset(seed=0)
    for step in range(1, max_steps + 1):
        _, _, terminated, truncated, _ = env.step(-np.ones((1, 4), np.float32))
        if terminated | truncated:
            return step, terminated.item(), truncated.item()
    raise AssertionError


def test_the_last_step_may_both_terminate_and_truncate() -> None:
    steps, *flags = ended(10_000)
    assert flags == [True, False]
    assert ended(steps) == (steps, True, True)
    assert ended(steps - 1) == (steps - 1, False, True)


TINY = replace(BASELINE.arm, inertia_a=4.4e-6, inertia_b=1e-5, coupling=-5.8e-7)
NEAR = math.sqrt(BASELINE.arm.inertia_a * BASELINE.arm.inertia_b) * (1.0 - 1e-9)

REFUSED: dict[str, tuple[str, Callable[[], Any]]] = {
    "a tiny inertia": ("hand", lambda: Batch(replace(BASELINE, arm=TINY), PathFollowing())),
    "a huge push": ("hand", lambda: Batch(BASELINE, PathFollowing(hand=MultiSineHand(push=1e7)))),
    "a huge recording": (
        "hand",
        lambda: Batch(
            BASELINE,
            PathFollowing(
                hand=RecordedForces(times=(0.0, 1.0), along=(0.0, 1e8), across=(0.0, 0.0))
            ),
        ),
    ),
    "a stiff person and late control": (
        "hand",
        lambda: Batch(
            BASELINE,
            PathFollowing(
                control_period=0.5,
                hand=HumanArm(impedance=Hand(mass=1.0, damping=9.0, stiffness=900.0)),
            ),
        ),
    ),
    "a huge damping": (r"Hand\.damping", lambda: Hand(damping=1e308)),
    "a large damping": (
        "arm",
        lambda: Batch(replace(BASELINE, hand=Hand(damping=1e11)), PathFollowing()),
    ),
    "a near-singular arm": (
        "arm",
        lambda: Batch(replace(BASELINE, arm=replace(BASELINE.arm, coupling=NEAR)), PathFollowing()),
    ),
    "a fast start": (
        "starts",
        lambda: Batch(
            BASELINE, PathFollowing(pace=5.0, singularity_margin=1e-3, starts=Starts(moving=1.0))
        ),
    ),
    "a tiny substep": (
        "control_period",
        lambda: Batch(replace(BASELINE, substep=1e-7), PathFollowing()),
    ),
    "a huge whole number": ("length_a", lambda: Arm(length_a=10**400)),
    "a huge phase": ("phases", lambda: MultiSineHand(phases=(1e300,) * 5)),
}


def test_a_condition_of_just_ten_thousand_is_accepted():
    """The eigenvalues of these are 5000 ± the coupling, their bound 10,000 over the smaller one."""
    arm = replace(BASELINE.arm, inertia_a=5000.0, inertia_b=5000.0, coupling=4999.0)
    task = PathFollowing(hand=MultiSineHand(push=0.0, amplitudes=(0.0,) * 5))
    check_motion(task, replace(BASELINE, arm=arm))
    with pytest.raises(ParameterError, match="condition"):
        check_motion(task, replace(BASELINE, arm=replace(arm, coupling=4999.1)))


@pytest.mark.parametrize(("text", "make"), REFUSED.values(), ids=REFUSED)
def test_values_beyond_the_limits_are_refused(text: str, make: Callable[[], Any]) -> None:
    with pytest.raises(ParameterError, match=text):
        make()


@pytest.mark.parametrize("name", SCENARIOS)
def test_draws_of_scenarios_are_far_from_the_limits(name: str) -> None:
    for machine, task in SCENARIOS[name].draws.pairs(64):
        arm = held_machine(task, machine).model.arm
        force = strongest(task, machine)
        assert force < 0.5 * largest_force(arm, machine.substep, task.control_period)
        assert condition(arm, machine.substep) < 10.0
        assert largest_energy(arm, machine.substep, task.control_period, force) > 100.0


@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_the_paper_may_be_controlled_four_times_a_second(machine: Machine) -> None:
    check_machine(PathFollowing(control_period=0.25), machine)


linkages = st.builds(
    lambda a, b, share: Linkage(0.5, 0.4, a, b, share * math.sqrt(a * b), 0.0, 0.0, 0.5),
    st.floats(1e-3, 1e3),
    st.floats(1e-3, 1e3),
    st.floats(-0.99, 0.99),
)


@settings(derandomize=True, deadline=None, database=None)
@given(linkages, st.floats(1e-5, 1e-2), st.integers(1, 1000))
def test_shares_match_the_derivation(arm: Linkage, h: float, count: int) -> None:
    period = count * h
    smallest = smallest_inertia(arm)
    assert smallest == pytest.approx(
        float(np.linalg.eigvalsh([[arm.m11, arm.coupling], [arm.coupling, arm.m22]])[0]), rel=1e-6
    )
    motion = largest_motion(arm, h, period)
    most = math.sqrt(motion)
    beta = h * (8.6 * arm.coupling**2 / smallest + 0.56 * abs(arm.coupling)) / smallest**2
    lengthened = period + math.sqrt(h * period)
    assert beta * motion * lengthened <= 0.3 * (1.0 + 1e-9)
    assert h * most / math.sqrt(smallest) <= MAX_TURN * (1.0 + 1e-9)
    assert h * abs(arm.coupling) * most <= smallest**1.5 / 12.0 * (1.0 + 1e-9)
    pull = largest_force(arm, h, period) * math.hypot(0.5, 0.4) / math.sqrt(smallest)
    assert h * pull <= most / 10.0 * (1.0 + 1e-9)
    assert 1.04 * pull * lengthened <= 0.67 * most * (1.0 + 1e-9)
    speed = 1.04 * most / math.sqrt(smallest)
    assert largest_travel(arm, h, period) == pytest.approx(period * speed * math.hypot(0.5, 0.4))
    for share in (0.0, 0.5, 1.0):
        start = math.sqrt(
            2.0 * largest_energy(arm, h, period, share * largest_force(arm, h, period))
        )
        assert start == pytest.approx(0.7 * most - 1.04 * share * pull * lengthened)


# --- at run time ---


@pytest.mark.parametrize("coupling", [0.0, 5e-324, 1e-310, 1e-200, -5e-324])
def test_a_coupling_that_underflows_counts_as_zero(coupling: float) -> None:
    arm = model_of(BASELINE).arm
    smallest = min(arm.m11, arm.m22)
    turning = smallest * (MAX_TURN / 1e-3) ** 2
    assert largest_motion(arm._replace(coupling=coupling), 1e-3, 0.01) == pytest.approx(turning)
    machine = replace(BASELINE, arm=replace(BASELINE.arm, coupling=coupling))
    check_machine(PathFollowing(), machine)


def test_an_arm_that_is_too_fast_ends_its_episode_as_a_failure_with_the_reason() -> None:
    """The strongest hand that is accepted, on an arm with almost all the energy it may have."""
    task = PathFollowing()
    most = largest_force(model_of(BASELINE).arm, BASELINE.substep, task.control_period)
    batch = Batch(BASELINE, replace(task, hand=MultiSineHand(push=most, amplitudes=(0.0,) * 5)))
    batch.reset([0])
    state = batch.get_state()
    limit = largest_energy(model_of(BASELINE).arm, BASELINE.substep, 0.01, most)
    state["worlds"][0, ROW.motion.omega_a, 0] = -math.sqrt(
        2.0 * 0.9999 * limit / BASELINE.arm.inertia_a
    )
    batch.set_state(state)
    obs, row, reward, terminated, _, success = batch.step_alone(np.zeros(4))
    assert np.isfinite([*obs, *row, reward]).all()
    assert (terminated, success) == (True, False)
    assert reason_of(row, *batch.pairs[0]) == Reason.TOO_FAST


def test_reasons_agree_with_the_flags() -> None:
    tasks = [
        PathFollowing(arrival=1.0),
        PathFollowing(arrival=1e-6),
        PathFollowing(error_max=0.01),
        PathFollowing(hand=MultiSineHand(push=-60.0)),
    ]
    batch = Batch([BASELINE] * 4, tasks, max_steps=400)
    batch.reset([0, 1, 2, 3])
    found: list[set[Reason | None]] = [set() for _ in tasks]
    rng = np.random.default_rng(0)
    for _ in range(600):
        returns = batch.step(rng.uniform(0.0, 2.0, (4, 4)), SAME_STEP)
        ended = returns.flags[FLAG.terminated]
        for world in np.flatnonzero(returns.flags.any(axis=0)):
            reason = reason_of(returns.telemetry[1, world], *batch.pairs[world])
            assert (reason is None) == (not ended[world])
            assert (reason is Reason.ARRIVED) == returns.flags[FLAG.success, world]
            found[world].add(reason)
        assert all(reason_of(row, *batch.pairs[0]) is None for row in returns.telemetry[0][~ended])
    assert found == [{Reason.ARRIVED}, {Reason.MISSED}, {Reason.STRAYED}, {Reason.SINGULAR}]


def test_reason_of_refuses_a_short_row() -> None:
    with pytest.raises(ParameterError, match="telemetry"):
        reason_of(np.zeros(3), BASELINE, PathFollowing())


# --- states and copies ---


@pytest.mark.parametrize(
    "row", [ROW.motion.theta_a, ROW.torques.dynamic.x1, ROW.foot.normal_error, ROW.pace_ratio]
)
def test_a_state_that_is_not_finite_is_refused_and_nothing_changes(row: int) -> None:
    batch = Batch(BASELINE, PathFollowing(), 70)
    batch.reset(list(range(70)))
    before, wrong = batch.get_state(), batch.get_state()
    for value in (np.inf, np.nan):
        wrong["worlds"][1, row, 3] = value
        with pytest.raises(ParameterError, match="worlds"):
            batch.set_state(wrong)
    assert all(before[name].tobytes() == part.tobytes() for name, part in batch.get_state().items())


def test_a_state_that_is_too_fast_is_refused_but_not_one_that_has_ended_so() -> None:
    batch = Batch(BASELINE, PathFollowing(), 2)
    batch.reset([0, 1])
    state = batch.get_state()
    state["worlds"][0, ROW.motion.omega_b, 0] = 1e6
    with pytest.raises(ParameterError, match="worlds"):
        batch.set_state(state)
    state["worlds"][0, ROW.alive, 0] = 0.0
    batch.set_state(state)


LARGE = 1100
"""Worlds that several threads share."""


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda batch: pickle.loads(pickle.dumps(batch))])
def test_a_copy_of_a_threaded_batch_goes_on_with_the_same_bits(
    copied: Callable[[Batch], Batch],
) -> None:
    batch = Batch(
        BASELINE, PathFollowing(hand=MultiSineHand(random_phases=True)), LARGE, num_threads=3
    )
    batch.reset(list(range(LARGE)))
    volts = np.random.default_rng(0).uniform(0.0, 8.0, (6, LARGE, 4))
    batch.step(volts[0])
    other = copied(batch)
    for row in volts[1:]:
        mine, theirs = batch.step(row, SAME_STEP), other.step(row, SAME_STEP)
        assert mine.obs.tobytes() == theirs.obs.tobytes()
        assert mine.rewards.tobytes() == theirs.rewards.tobytes()
        assert mine.telemetry[0].tobytes() == theirs.telemetry[0].tobytes()
    assert batch.get_state()["worlds"].tobytes() == other.get_state()["worlds"].tobytes()
    batch.close()
    other.step(volts[0], SAME_STEP)
    other.close()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda batch: pickle.loads(pickle.dumps(batch))])
def test_a_copy_of_one_world_is_another_world(copied: Callable[[Batch], Batch]) -> None:
    one = Batch(BASELINE, PathFollowing(), 1)
    one.reset([0])
    one.step_alone(np.full(4, 3.0))
    other = copied(one)
    mine, before = one.step_alone(np.full(4, 3.0)), one.get_state()
    obs = mine[0].copy()
    assert obs.tobytes() == other.step_alone(np.full(4, 3.0))[0].tobytes()
    other.step_alone(np.full(4, 3.0))
    assert before["worlds"].tobytes() == one.get_state()["worlds"].tobytes()
    one.step_alone(np.full(4, 3.0))
    assert mine[0].tobytes() == obs.tobytes(), "what a step has returned stays"
