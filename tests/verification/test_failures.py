"""Clutches that fail: what is left of their torque, what they hold, and who is told."""

import math
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from pter_gym import BASELINE, Machine
from pter_gym._compiled.records import flat
from pter_gym._engine.batch import Batch
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers import FailureDetector
from pter_gym.envs._mixin import find_worlds
from pter_gym.errors import ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import MACHINES
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios.distributions import OneOf, Uniform, Vary
from pter_gym.tasks._codec import codec
from pter_gym.tasks.path_following import COLUMN, OBS, Failure, PathFollowing, Starts, check_machine

STEPS, MOMENT = 30, 12
"""Control steps of an episode, and those before a clutch fails."""

VOLTS = np.random.default_rng(1).uniform(0.0, 4.0, (STEPS, 4)).astype(np.float32)

GENTLE = MultiSineHand(push=12.0)

LATER = {"after": 0.01 * MOMENT}


def ran(
    *failures: Failure, volts: NDArray[np.float32] = VOLTS, machine: Machine = BASELINE, **task: Any
) -> tuple[Batch, Any, Any]:
    """Return a world after an episode that goes on, its telemetry and its observations."""
    task = {"hand": GENTLE, **task}
    batch = Batch(machine, PathFollowing(failures=failures, **task))
    obs, rows = batch.reset([0])
    telemetry, observations = [rows[0]], [obs[0]]
    for command in volts:
        returns = batch.step(command[None])
        telemetry.append(returns.telemetry[0, 0])
        observations.append(returns.obs[0])
    return batch, np.array(telemetry), np.array(observations)


def moved(world: Batch) -> list[Any]:
    """Return all of a world's state but the command, as numbers."""
    return flat(world.get_worlds()._replace(command=PerClutch(*np.zeros((4, 1)))))


def test_what_fails_later_has_no_effect_until_then() -> None:
    """And nothing differs from a healthy machine, bit for bit."""
    _, healthy, seen = ran()
    for failure in (Failure(clutch=2, torque=0.0, **LATER), Failure(clutch=2, volts=9.0, **LATER)):
        _, rows, obs = ran(failure)
        np.testing.assert_array_equal(rows[: MOMENT + 1], healthy[: MOMENT + 1])
        np.testing.assert_array_equal(obs[: MOMENT + 1], seen[: MOMENT + 1])
        assert not np.array_equal(rows[MOMENT + 1], healthy[MOMENT + 1])


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_share_of_the_torque_is_that_of_a_weaker_clutch(share: float) -> None:
    scale = tuple(share if clutch == 3 else 1.0 for clutch in range(1, 5))
    world, rows, _ = ran(Failure(clutch=3, torque=share))
    weaker, expected, _ = ran(machine=replace(BASELINE, clutch_scale=scale))
    np.testing.assert_allclose(rows[:, [*COLUMN.tip]], expected[:, [*COLUMN.tip]], atol=1e-12)
    np.testing.assert_allclose(moved(world), moved(weaker), atol=1e-9)


def test_torque_is_lost_with_the_lag_of_the_clutch() -> None:
    lag = BASELINE.clutch.time_constant
    world, rows, _ = ran(Failure(clutch=4, torque=0.0, **LATER))
    at_failure, _, _ = ran(volts=VOLTS[:MOMENT])
    left = np.exp(-0.01 * (STEPS - MOMENT) / lag)
    expected = left * at_failure.get_worlds().torques.dynamic.x4
    assert world.get_worlds().torques.dynamic.x4 == pytest.approx(expected, rel=1e-12)
    assert (np.abs(rows[MOMENT + 1 :, COLUMN.torque.x4]) > 0.0).any()


@pytest.mark.parametrize(
    "machine", [BASELINE, replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage"))]
)
def test_a_clutch_that_holds_a_voltage_is_one_that_is_given_it(machine: Machine) -> None:
    """All but what shows the command has the same bits."""
    given = VOLTS.copy()
    given[MOMENT:, 1] = 6.0
    world, rows, obs = ran(Failure(clutch=2, volts=6.0, **LATER), machine=machine)
    other, expected, seen = ran(volts=given, machine=machine)
    np.testing.assert_array_equal(moved(world), moved(other))
    command = [*COLUMN.volts, COLUMN.terms.effort, COLUMN.reward]
    np.testing.assert_array_equal(*(np.delete(each, command, 1) for each in (rows, expected)))
    np.testing.assert_array_equal(*(np.delete(each, OBS.volts.x2, 1) for each in (obs, seen)))
    np.testing.assert_array_equal(rows[1:, [*COLUMN.volts]], VOLTS)
    np.testing.assert_array_equal(obs[1:, [*OBS.volts]], VOLTS / np.float32(24.0))


@pytest.mark.parametrize("starts", [Starts(), Starts(gripped=1.0), Starts(moving=1.0)])
def test_what_failed_before_the_start_has_settled(starts: Starts) -> None:
    failures = Failure(clutch=1, volts=6.0), Failure(clutch=2, torque=0.0)
    batch = Batch(BASELINE, PathFollowing(starts=starts, failures=failures), 20)
    batch.reset(list(range(20)))
    torques = batch.get_worlds().torques.dynamic
    np.testing.assert_array_equal(torques.x1, BASELINE.clutch.dynamic.torque(6.0))
    np.testing.assert_array_equal(torques.x2, 0.0)


def test_a_failing_arm_gains_no_energy() -> None:
    """Each step's ledger closes, and clutches only take."""
    failures = Failure(clutch=1, torque=0.0, **LATER), Failure(clutch=3, volts=8.0, **LATER)
    _, rows, _ = ran(*failures, Failure(clutch=4, torque=0.5, volts=2.0, after=0.05))
    energy = COLUMN.energy
    ledger = rows[:, energy.hand_work] - rows[:, energy.dissipated] + rows[:, energy.residual]
    ledger -= rows[:, energy.numerical_loss]
    kinetic = rows[:, COLUMN.kinetic_energy]
    np.testing.assert_allclose(np.diff(kinetic), ledger[1:], atol=1e-12 * (1.0 + kinetic.max()))
    assert (rows[:, energy.dissipated] >= 0.0).all()
    assert (rows[:, [*COLUMN.power]] <= 0.0).all()


def test_what_is_privileged_shows_failures() -> None:
    world, _, _ = ran(Failure(clutch=2, torque=0.25, after=0.101), Failure(clutch=4, volts=6.0))
    told = dict(zip(world.privileged_layout.names, world.privileged()[0], strict=True))
    numbers = {
        name: [told[f"task_failed_{name}_{k}"] for k in range(1, 5)]
        for name in ("torque", "volts", "after")
    }
    assert numbers == {
        "torque": [1.0, 0.25, 1.0, 1.0],
        "volts": [-1.0, -1.0, -1.0, 6.0],
        "after": [0.0, 11.0, 0.0, 0.0],
    }
    assert not [name for name in world.layout.names if "failed" in name]


def test_a_state_of_a_failing_world_goes_on() -> None:
    failure = Failure(clutch=2, volts=6.0, **LATER)
    world, _, _ = ran(failure, volts=VOLTS[: MOMENT + 3])
    copies = [Batch(BASELINE, world.task) for _ in range(2)]
    for copy in copies:
        copy.reset([0])
    copies[0].set_state(world.get_state())
    copies[1].set_worlds(world.get_worlds())
    for command in VOLTS[MOMENT + 3 :]:
        for each in (world, *copies):
            each.step(command[None])
    for copy in copies:
        np.testing.assert_array_equal(flat(copy.get_worlds()), flat(world.get_worlds()))


def test_failures_are_stored_with_a_task_if_there_are_any() -> None:
    assert "failures" not in codec().to_plain(PathFollowing())  # type: ignore[operator]
    task = PathFollowing(failures=(Failure(clutch=2, torque=0.0, after=0.5),))
    assert codec().from_plain(codec().to_plain(task)) == task


def test_digests_are_older_than_failures_and_tell_them() -> None:
    task = PathFollowing(pace=0.3)
    assert find_scenario(task).digest == "fae40ed9bc664ade"
    failing = replace(task, failures=(Failure(clutch=2, torque=0.0),))
    assert find_scenario(failing).digest != find_scenario(task).digest
    clutch = replace(BASELINE.clutch, hysteresis=0.05)
    others = BASELINE, replace(BASELINE, clutch=clutch)
    assert len({find_scenario(task, machine).digest for machine in others}) == 2


def test_an_environment_is_made_again_from_its_spec() -> None:
    given: Any = {"failures": [Failure(clutch=2, torque=0.0, after=0.5)]}
    env: Any = gymnasium.make("PTER/PathFollowing-v0", **given)
    again: Any = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert (
        again.unwrapped.task == env.unwrapped.task == PathFollowing(failures=(*given["failures"],))
    )


def test_failures_are_drawn() -> None:
    """Each episode's own, on a scenario and on paths of one's own."""
    failing = Vary(
        Failure(clutch=1, torque=0.0), clutch=OneOf((1, 2, 3, 4)), after=Uniform(0.0, 2.0)
    )
    worlds = find_worlds(scenario="standard", contexts=64, failures=OneOf(((), (failing,))))
    tasks: Any = worlds.tasks
    found = [task.failures for task in tasks]
    assert {len(failures) for failures in found} == {0, 1}
    assert {one.clutch for failures in found for one in failures} == {1, 2, 3, 4}
    assert worlds.nominal == BASELINE


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"clutch": 0, "torque": 0.0}, r"Failure\.clutch"),
        ({"clutch": 5, "torque": 0.0}, r"Failure\.clutch"),
        ({"clutch": 1}, r"Failure\.torque must be below 1"),
        ({"clutch": 1, "torque": 1.5}, r"Failure\.torque"),
        ({"clutch": 1, "volts": -1.0}, r"Failure\.volts"),
        ({"clutch": 1, "volts": float("nan")}, r"Failure\.volts"),
        ({"clutch": 1, "torque": 0.0, "after": -1.0}, r"Failure\.after"),
    ],
)
def test_what_is_no_failure_is_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        Failure(**wrong)


@pytest.mark.parametrize("failures", [Failure(clutch=1, torque=0.0), (3,), None])
def test_other_things_than_failures_are_refused(failures: Any) -> None:
    with pytest.raises(ParameterError, match=r"PathFollowing\.failures must be a tuple"):
        PathFollowing(failures=failures)


def test_a_clutch_fails_once_and_is_there() -> None:
    twice = Failure(clutch=1, torque=0.0), Failure(clutch=1, volts=6.0)
    with pytest.raises(ParameterError, match=r"each of another clutch"):
        PathFollowing(failures=twice)
    third = PathFollowing(failures=(Failure(clutch=3, torque=0.0),))
    with pytest.raises(ParameterError, match=r"Failure\.clutch must be one of the machine's 2"):
        check_machine(third, MACHINES["two-brakes"])
    with pytest.raises(ParameterError, match=r"Failure\.volts must be .* ≤ 24"):
        check_machine(PathFollowing(failures=(Failure(clutch=3, volts=24.1),)), BASELINE)


def looked(detector: FailureDetector, *failures: Failure, **options: Any) -> list[int]:
    """Return what a detector says at each control instant of an episode."""
    _, _, observations = ran(*failures, **options)
    memory = detector.start(1)
    return [int(detector.look(obs[None, :24], memory)[0]) for obs in observations]


def test_a_dead_clutch_is_named_once_it_slips_and_should_exert_a_torque() -> None:
    """After eight control steps, of which the first has more than 3 N·m; and no healthy one is."""
    volts = np.tile(np.array([6.0, 0.0, 0.0, 0.0], np.float32), (30, 1))
    push = {"volts": volts, "hand": MultiSineHand(push=20.0)}
    detector = FailureDetector(BASELINE)
    assert set(looked(detector, **push)) == {0}
    verdicts = looked(detector, Failure(clutch=1, torque=0.0), **push)
    lag, settled = BASELINE.clutch.time_constant, BASELINE.clutch.dynamic.torque(6.0)
    suspected = math.ceil(-math.log(1.0 - 3.0 / settled) * lag / 0.01)
    assert verdicts == [0] * (suspected + 7) + [1] * (31 - suspected - 7)


def test_a_clutch_that_is_stuck_on_is_named_where_it_holds_a_load() -> None:
    volts = np.zeros((20, 4), np.float32)
    detector = FailureDetector(BASELINE)
    assert set(looked(detector, volts=volts)) == {0}
    verdicts = looked(detector, Failure(clutch=3, volts=12.0), volts=volts, hand=MultiSineHand())
    assert verdicts[-1] == 3


def test_a_detector_looks_at_each_world_by_itself() -> None:
    failures = Failure(clutch=2, torque=0.0), Failure(clutch=4, torque=0.0)
    batch = Batch(BASELINE, [PathFollowing(failures=(one,)) for one in failures])
    detector, memory = FailureDetector(BASELINE), FailureDetector(BASELINE).start(2)
    obs, _ = batch.reset([0, 1])
    detector.look(obs, memory)
    for _ in range(20):
        obs = batch.step(np.full((2, 4), [0.0, 8.0, 0.0, 8.0], np.float32)).obs
        verdict = detector.look(obs, memory)
    assert verdict.tolist() == [2, 4]
