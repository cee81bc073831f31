"""One world has the same bits alone, as a row of a batch, in plain Python and in another process."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import pter_gym  # noqa: F401  (registers the environment)
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import FLAG, SAME_STEP, SKIP, Readings
from pter_gym.controllers import Random, TorqueFeedback
from pter_gym.controllers._base import Policy
from pter_gym.hands import MultiSineHand, RecordedForces
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Machine
from pter_gym.paths import Line
from pter_gym.tasks.path_following import MAX_DELAY, TELEMETRY, PathFollowing

STEPS = 200
TASK = PathFollowing(path=Line(length=0.2), start_offset=0.01, hand=MultiSineHand(random_phases=True))


def machines(count: int) -> list[Machine]:
    """Different materials and time constants, some with the lag on the voltage."""
    materials = (BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL)
    return [
        replace(
            materials[k % 3],
            clutch=replace(
                materials[k % 3].clutch,
                time_constant=0.02 + 0.01 * (k % 11),
                lag="voltage" if k % 4 == 3 else "normal_force",
            ),
        )
        for k in range(count)
    ]


def live(batch: Batch, seeds: list[int], actions: np.ndarray) -> list[np.ndarray]:
    """Step with given actions (steps, N, 4) and unseeded resets at the end of episodes; return all that came out."""
    obs, telemetry = batch.reset(seeds)
    out = [obs.copy(), telemetry.copy()]
    for rows in actions:
        returns = batch.step(rows)
        out += [returns.obs, returns.rewards, returns.flags, returns.telemetry]
        ended = returns.flags[FLAG.terminated]
        if ended.any():
            obs, telemetry = batch.reset(chosen=ended)
            out += [obs[ended], telemetry[ended]]
    return out


def same(one: dict[str, np.ndarray], two: dict[str, np.ndarray]) -> bool:
    """Whether two states hold the same bits."""
    return one.keys() == two.keys() and all(one[name].tobytes() == two[name].tobytes() for name in one)


def draw(count: int) -> np.ndarray:
    """Random voltages (STEPS, count, 4): half of them low, so episodes end and begin again."""
    rng = np.random.default_rng(7)
    return (rng.uniform(0.0, 24.0, (STEPS, count, 4)) * rng.integers(0, 2, (STEPS, count, 4))).astype(np.float32)


def digest() -> str:
    """Hash everything that three worlds put out over some episodes, with laws compiled and called from Python."""
    batch = Batch(machines(4), TASK)
    content = hashlib.sha256()
    for array in live(batch, [5, 6, 7, 8], draw(4)[:40]):
        content.update(array.tobytes())
    obs, _ = batch.reset([1, 2, 3, 4])
    policies = [TorqueFeedback().bind(BASELINE, batch.layout), Random(seed=9).bind(BASELINE, batch.layout)]
    for policy in policies:
        for _ in range(10):
            returns = batch.step(policy(obs))
            obs = returns.obs
            content.update(obs.tobytes() + returns.telemetry.tobytes())
    return content.hexdigest()


@pytest.mark.parametrize("setting", ["", "NUMBA_DISABLE_JIT=1"])
def test_another_process_has_the_same_bits(setting: str) -> None:
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_batch; print(test_batch.digest())"
    )
    found = subprocess.run(
        ["env", *filter(None, [setting]), sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == digest()


@pytest.mark.parametrize("policy", [TorqueFeedback(), Random(seed=4)])
def test_a_compiled_rollout_has_the_bits_of_stepping_from_python(policy: TorqueFeedback | Random) -> None:
    seeds = list(range(9))
    one, two = Batch(machines(9), TASK), Batch(machines(9), TASK)
    bound: Policy = policy.bind(BASELINE, one.layout)
    obs, _ = one.reset(seeds)
    last, telemetry = one.rollout(obs, bound.law, bound.gains, 120)
    obs, _ = two.reset(seeds)
    for row in telemetry:
        obs, _, _, _, (rows,) = two.step(bound(obs), SKIP)
        assert row.tobytes() == rows.tobytes()
        running = np.isfinite(rows[:, 0])
        assert running.sum() == np.isfinite(row[:, 0]).sum()
    assert last[running].tobytes() == obs[running].tobytes()
    assert same(one.get_state(), two.get_state())


def test_plain_python_calls_the_law_with_the_same_bits() -> None:
    batch = Batch(machines(5), TASK)
    bound = TorqueFeedback().bind(BASELINE, batch.layout)
    obs, _ = batch.reset([0] * 5)
    for _ in range(30):
        volts = bound(obs)
        assert volts[2].tobytes() == bound(obs[2]).tobytes()
        law = getattr(bound.law, "py_func", bound.law)
        plain = law(obs[2], batch.layout.scales, bound.gains, bound.empty_memory(1)[0])
        assert np.array(plain, np.float32).tobytes() == volts[2].tobytes()
        obs = batch.step(volts).obs


def test_same_seed_same_episode_and_other_seed_another() -> None:
    batch = Batch(BASELINE, TASK, 3)
    obs, _ = batch.reset([1, 1, 2])
    assert obs[0].tobytes() == obs[1].tobytes()
    assert obs[0].tobytes() != obs[2].tobytes()


def test_an_unseeded_reset_goes_on_to_the_next_episode() -> None:
    batch = Batch(BASELINE, TASK)
    first = batch.reset([1])[0]
    second = batch.reset()[0]
    assert first.tobytes() != second.tobytes()
    batch.reset([1])
    assert batch.reset()[0].tobytes() == second.tobytes()


def test_adjacent_seeds_share_no_draw() -> None:
    batch = Batch(BASELINE, TASK, 64)
    starts = batch.reset(list(range(64)))[1][:, TELEMETRY.index("normal_error")]
    assert len(np.unique(starts)) == 64


def test_step_leaves_earlier_returns_untouched() -> None:
    env = gymnasium.make("PTER/PathFollowing-v0")
    obs, info = env.reset(seed=0)
    kept = [(obs, obs.copy(), info["telemetry"], info["telemetry"].copy())]
    for _ in range(20):
        obs, _, _, _, info = env.step(np.full(4, 20.0, np.float32))
        kept.append((obs, obs.copy(), info["telemetry"], info["telemetry"].copy()))
    for obs, obs_copy, row, row_copy in kept:
        assert obs.tobytes() == obs_copy.tobytes()
        assert row.tobytes() == row_copy.tobytes()


def test_a_world_keeps_what_its_sensors_read_for_the_longest_delay() -> None:
    assert len(Readings._fields) == 1 + MAX_DELAY


def test_a_control_period_has_equal_substeps_no_longer_than_the_machines() -> None:
    """As a machine whose substep divides the period has them, bit by bit."""
    task = PathFollowing(control_period=0.004)
    odd, even = (Batch(replace(BASELINE, substep=substep), task, 3) for substep in (2.5e-3, 2e-3))
    for batch in (odd, even):
        batch.reset([1, 2, 3])
    volts = np.random.default_rng(0).uniform(0.0, 8.0, (20, 3, 4))
    for row in volts:
        mine, theirs = odd.step(row), even.step(row)
        assert mine.obs.tobytes() == theirs.obs.tobytes()
        assert mine.telemetry[0].tobytes() == theirs.telemetry[0].tobytes()


def test_an_episode_that_ends_in_the_same_step_leaves_its_last_observation() -> None:
    plain, same = (Batch(BASELINE, PathFollowing(), 2, max_steps=2) for _ in range(2))
    for batch in (plain, same):
        batch.reset([3, 4])
    for _ in range(2):
        ended, begun = plain.step(np.full((2, 4), 1.0)), same.step(np.full((2, 4), 1.0), SAME_STEP)
    np.testing.assert_array_equal(begun.final_obs, ended.obs)
    assert not np.array_equal(begun.obs, ended.obs)


def test_an_arrival_is_told_by_ones() -> None:
    batch = Batch(BASELINE, PathFollowing(path=Line(x=-0.1, y=0.55, length=1e-3), arrival=0.2))
    batch.reset([0])
    row = batch.step(np.zeros((1, 4))).telemetry[0, 0]
    assert (row[TELEMETRY.index("terminated")], row[TELEMETRY.index("is_success")]) == (1.0, 1.0)


def test_recorded_forces_are_felt_at_their_instants_and_the_last_ones_ever_after() -> None:
    hand = RecordedForces(times=(0.0, 0.01, 0.02), along=(1.0, 3.0, -2.0), across=(0.0, 5.0, 1.0))
    batch = Batch(BASELINE, PathFollowing(path=Line(x=-0.2, y=0.55, direction=0.0, length=0.4), hand=hand))
    batch.reset([0])
    rows = np.array([batch.step(np.zeros((1, 4))).telemetry[0, 0] for _ in range(4)])
    felt = rows[:, [TELEMETRY.index("force_x"), TELEMETRY.index("force_y")]]
    np.testing.assert_allclose(felt, [[3.0, 5.0], [-2.0, 1.0], [-2.0, 1.0], [-2.0, 1.0]], rtol=1e-9)
