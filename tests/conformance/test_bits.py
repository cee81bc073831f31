"""A world has the same bits alone, as any row of a batch, on any number of threads, with held
actions, in any process.

All over automatic resets, with machines, tasks and hands of many kinds.
"""

import hashlib
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, reduce
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from hypothesis import Phase, given, settings, strategies as st

import pter_gym
from pter_gym._compiled.records import flat, read, rows
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import LANES, SAME_STEP as SAME, SKIP
from pter_gym.benchmark import from_actions
from pter_gym.controllers import Impedance, Random, TorqueFeedback, bind
from pter_gym.errors import ParameterError, ResetNeededError
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Machine
from pter_gym.paths import Arc, Line, Sine
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, Failure, PathFollowing, Sensing
from rollouts import Acting, run

ID = "PTER/PathFollowing-v0"
NEXT_STEP, SAME_STEP, DISABLED = (
    AutoresetMode.NEXT_STEP,
    AutoresetMode.SAME_STEP,
    AutoresetMode.DISABLED,
)
STEPS, LIMIT = 150, 45
ALONE = 45  # two blocks, the second one not full
THREADED = 1100  # more than INLINE_BLOCKS blocks

Record = dict[str, np.ndarray]
each_mode = pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)


def machines(count: int) -> list[Machine]:
    """Different materials, time constants and kinds of lag."""
    kinds = [
        replace(material, clutch=replace(material.clutch, time_constant=time_constant, lag=lag))
        for material in (BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL)
        for time_constant in (0.03, 0.105)
        for lag in ("normal_force", "voltage")
    ]
    return [kinds[k % len(kinds)] for k in range(count)]


def tasks(count: int) -> list[PathFollowing]:
    """Different paths, hands, sensors and starts."""
    kinds = [
        PathFollowing(start_offset=0.01, hand=MultiSineHand(random_phases=True)),
        PathFollowing(start_offset=0.02, hand=MultiSineHand(push=90.0, random_phases=True)),
        PathFollowing(start_offset=0.005, path=Line(x=-0.1, y=0.5, direction=0.1, length=0.2)),
        PathFollowing(start_offset=0.015, error_max=0.02, hand=MultiSineHand(random_phases=True)),
        PathFollowing(
            hand=MultiSineHand(push=30.0),
            failures=(Failure(clutch=1, torque=0.5), Failure(clutch=3, volts=4.0, after=0.1)),
        ),
        PathFollowing(
            path=Arc(x=-0.3, y=0.6, radius=0.3, angle=-1.0),
            hand=HumanArm(random_phases=True),
            error_max=0.1,
            sensing=Sensing(
                angle_resolution=1e-3,
                velocity_noise=0.01,
                torque_noise=0.1,
                force_noise=0.1,
                delay=1,
            ),
        ),
        PathFollowing(
            path=Sine(x=-0.5, y=0.65, extent=0.8, amplitude=0.04),
            hand=RecordedForces(
                times=(0.0, 0.013, 0.3), along=(40.0, 60.0, 80.0), across=(0.0, 9.0, -9.0)
            ),
            error_max=0.1,
            friction_drift=0.1,
        ),
    ]
    return [kinds[k % len(kinds)] for k in range(count)]


def seeds(count: int) -> list[int]:
    return [17 * k + 3 for k in range(count)]


@cache
def actions(count: int) -> np.ndarray:
    """Random voltages (STEPS, count, 4), half of them zero, of a world the same in any count."""
    drawn = np.random.default_rng(7).random((count, STEPS, 8), np.float32)
    return np.ascontiguousarray((24.0 * drawn[..., :4] * (drawn[..., 4:] < 0.5)).swapaxes(0, 1))


def make(count: int, mode: AutoresetMode, **options: Any) -> Any:
    given = {
        "machine": machines(count),
        "task": tasks(count),
        "max_episode_steps": LIMIT,
        "action_unit": "volt",
        **options,
    }
    return gymnasium.make_vec(ID, num_envs=count, autoreset_mode=mode, **given)


def live(env: Any, first: Sequence[int] | None, voltages: np.ndarray) -> Iterator[Record]:
    """Reset, unless ``first`` is None, and step; yield what came out, as with SAME_STEP."""
    if first is not None:
        obs, infos = env.reset(seed=list(first))
        yield {"obs": obs, "telemetry": infos["telemetry"]}
    for row in voltages:
        obs, rewards, terminated, truncated, infos = env.step(row)
        ended = terminated | truncated
        final_obs, final_telemetry = np.zeros_like(obs), np.zeros_like(infos["telemetry"])
        success, telemetry = infos["is_success"], infos["telemetry"]
        if env.metadata["autoreset_mode"] == SAME_STEP and ended.any():
            final_obs[ended] = np.stack(infos["final_obs"][ended])
            final_telemetry[ended] = infos["final_info"]["telemetry"][ended]
            success = success | infos["final_info"]["is_success"]
        elif env.metadata["autoreset_mode"] == DISABLED and ended.any():
            final_obs[ended], final_telemetry[ended] = obs[ended], telemetry[ended]
            obs, infos = env.reset(options={"reset_mask": ended})
            telemetry = np.where(ended[:, None], infos["telemetry"], telemetry)
        flags = {"terminated": terminated, "truncated": truncated, "success": success}
        last = {"final_obs": final_obs, "final_telemetry": final_telemetry}
        yield {"obs": obs, "telemetry": telemetry, "rewards": rewards, **flags, **last}


def live_alone(world: int, mode: AutoresetMode, skip: int) -> Iterator[Record]:
    """The same of one world in an environment of its own, reset with its seed and then without."""
    kinds = {"machine": machines(world + 1)[-1], "task": tasks(world + 1)[-1]}
    env = gymnasium.make(ID, **kinds, action_unit="volt", frame_skip=skip, max_episode_steps=LIMIT)
    obs, info = env.reset(seed=seeds(world + 1)[-1])
    yield {"obs": obs, "telemetry": info["telemetry"]}
    ended = False
    for row in actions(ALONE)[:, world]:
        if ended and mode == NEXT_STEP:
            obs, info = env.reset()
            reward, terminated, truncated, success = 0.0, False, False, False
        else:
            obs, reward, terminated, truncated, info = env.step(row)
            success = info["is_success"]
        ended = terminated or truncated
        final_obs, final_telemetry = np.zeros_like(obs), np.zeros_like(info["telemetry"])
        if ended and mode != NEXT_STEP:
            final_obs, final_telemetry = obs, info["telemetry"]
            obs, info = env.reset()
        flags = {
            "terminated": np.bool_(terminated),
            "truncated": np.bool_(truncated),
            "success": np.bool_(success),
        }
        last = {"final_obs": final_obs, "final_telemetry": final_telemetry}
        yield {
            "obs": obs,
            "telemetry": info["telemetry"],
            "rewards": np.float64(reward),
            **flags,
            **last,
        }


@cache
def alone(mode: AutoresetMode, skip: int = 1) -> list[Record]:
    """The records of all single worlds, put together."""
    lives = zip(*(list(live_alone(world, mode, skip)) for world in range(ALONE)), strict=True)
    return [
        {name: np.stack([record[name] for record in records]) for name in records[0]}
        for records in lives
    ]


def require_same(one: Record, two: Record, step: int) -> None:
    """Compare two records, bit for bit."""
    assert one.keys() == two.keys()
    for name, values in one.items():
        assert values.dtype == two[name].dtype, (name, step)
        assert values.tobytes() == two[name].tobytes(), (name, step)


def test_episodes_of_the_single_worlds_end_in_every_way() -> None:
    records = alone(SAME_STEP)[1:]
    terminated, truncated, success = (
        np.array([record[name] for record in records])
        for name in ("terminated", "truncated", "success")
    )
    for ends in (success & terminated, terminated & ~success, truncated & ~terminated):
        assert ends.sum() > 10


@each_mode
@pytest.mark.parametrize("skip", [1, 3])
def test_a_row_of_a_batch_equals_a_single_environment(skip: int, mode: AutoresetMode) -> None:
    env = make(ALONE, mode, frame_skip=skip)
    for step, record in enumerate(live(env, seeds(ALONE), actions(ALONE))):
        require_same(record, alone(mode, skip)[step], step)


def test_blocks_of_one_machine_each_have_the_bits_of_batches_of_it() -> None:
    kinds = (BASELINE, DELRIN_EXPERIMENTAL, BASELINE)
    both = Batch([kind for kind in kinds for _ in range(LANES)], PathFollowing())
    alone = [Batch(kind, PathFollowing(), LANES) for kind in kinds]
    for batch in (both, *alone):
        batch.reset([0] * batch.num_worlds)
    for row in actions(LANES)[:8]:
        expected = np.concatenate([batch.step(row).obs for batch in alone])
        assert both.step(np.tile(row, (len(kinds), 1))).obs.tobytes() == expected.tobytes()


def test_worlds_that_draw_other_constants_leave_the_next_block_its_own() -> None:
    kinds, tasks = [BASELINE, DELRIN_EXPERIMENTAL], [PathFollowing()] * 2

    def begun(seeds: Sequence[int]) -> Batch:
        batch = Batch(kinds, tasks, len(seeds), draws=True, max_steps=1)
        batch.reset(seeds)
        return batch

    seeds = [seed for seed, kind in enumerate(begun(range(6 * LANES)).context) if kind == 0]
    seeds = seeds[: 2 * LANES]
    both, second = begun(seeds), begun(seeds[LANES:])
    row = actions(LANES)[0]
    expected = second.step(row, int(SAME)).final_obs
    found = both.step(np.tile(row, (2, 1)), int(SAME))
    assert set(both.context[:LANES]) == {0, 1}
    assert found.final_obs[LANES:].tobytes() == expected.tobytes()


@each_mode
def test_any_number_of_threads_has_the_same_bits(mode: AutoresetMode) -> None:
    envs = [make(THREADED, mode, num_threads=threads) for threads in (1, 3)]
    lives = (live(env, seeds(THREADED), actions(THREADED)) for env in envs)
    for step, (one, other) in enumerate(zip(*lives, strict=True)):
        require_same(
            {name: values[:ALONE] for name, values in one.items()}, alone(mode)[step], step
        )
        require_same(one, other, step)


@each_mode
def test_after_a_checkpoint(mode: AutoresetMode) -> None:
    env, voltages, half = make(ALONE, mode), actions(ALONE), 57
    for _ in live(env, seeds(ALONE), voltages[:half]):
        pass
    state = env.get_state()
    expected = list(live(env, None, voltages[half:]))
    other = make(ALONE, mode, num_threads=3)
    other.reset(seed=123)
    for again in (other, env):
        again.set_state(state)
        for step, (one, two) in enumerate(
            zip(expected, live(again, None, voltages[half:]), strict=True)
        ):
            require_same(one, two, step)


PAY = [*COLUMN.terms, COLUMN.reward]


@pytest.mark.parametrize("name", ["Standard", "Everything"])
def test_worlds_put_into_a_state_go_on_from_it(name: str) -> None:
    """All of them from one too, where the machine and the task are the same."""
    settings: dict[str, Any] = {"contexts": 1, "action_unit": "volt", "max_episode_steps": 1000}
    first, other = (gymnasium.make_vec(f"PTER/{name}-v0", 3, **settings) for _ in range(2))
    same: Any = gymnasium.make_vec(f"PTER/{name}-v0", 40, **settings)
    first.reset(seed=[4, 5, 6])
    other.reset(seed=[4, 5, 6])
    same.reset(seed=[4] * 40)
    volts = np.random.default_rng(0).uniform(0.0, 9.0, (12, 3, 4)).astype(np.float32)
    for row in volts[:6]:
        first.step(row)
    state: Any = first.unwrapped.get_worlds()
    other.unwrapped.set_worlds(state)
    same.unwrapped.set_worlds(read(np.array(flat(state))[:, 0], rows(type(state)), 0))
    for row in volts[6:]:
        obs, rewards, *_, infos = first.step(row)
        for env, place in ((other, slice(None)), (same, slice(1))):
            found = env.step(row if env is other else np.tile(row[:1], (40, 1)))
            assert found[0][place].tobytes() == obs[place].tobytes()
            assert found[1][place].tobytes() == rewards[place].tobytes()
            told = found[4]["telemetry"][place]
            assert told.tobytes() == infos["telemetry"][place].tobytes()
        assert (found[0] == found[0][0]).all()


def test_states_that_worlds_cannot_hold_change_nothing() -> None:
    env: Any = gymnasium.make_vec("PTER/Standard-v0", 2, contexts=1).unwrapped
    with pytest.raises(ResetNeededError):
        env.set_worlds(env.get_worlds())
    env.reset(seed=0)
    state, before = env.get_worlds(), env.get_state()["worlds"]
    for wrong in (
        state._replace(reached=np.nan),
        state._replace(step=np.zeros(3)),
        state._replace(motion=state.motion._replace(omega_a=1e6)),
        state._replace(foot=state.foot._replace(segment=99.0)),
    ):
        with pytest.raises(ParameterError):
            env.set_worlds(wrong)
    assert env.get_state()["worlds"].tobytes() == before.tobytes()


@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(seed=st.integers(0, 2**31), skip=st.integers(2, 9))
def test_a_held_action_equals_a_repeated_one(seed: int, skip: int) -> None:
    shared = {
        "scenario": SCENARIOS["everything"].draws,
        "pace": "brisk",
        "contexts": 7,
        "context_seed": seed,
        "action_unit": "volt",
    }
    held: Any = gymnasium.make(ID, **shared, frame_skip=skip).unwrapped
    plain: Any = gymnasium.make(ID, **shared, frame_skip=1).unwrapped
    endings = 0
    for episode in range(6):
        (obs, _), (other, _) = (
            env.reset(seed=seed if episode == 0 else None) for env in (held, plain)
        )
        ended = False
        for action in (
            np.random.default_rng([seed, episode]).uniform(0.0, 9.0, (500, 4)).astype(np.float32)
        ):
            assert obs.tobytes() == other.tobytes()
            if ended:
                break
            obs, reward, *flags, info = held.step(action)
            total, paid = 0.0, np.full(len(PAY), -0.0)
            for _ in range(skip):
                other, pay, *ends, told = plain.step(action)
                total, paid = pay + total, told["telemetry"][PAY] + paid
                if any(ends):
                    break
            assert (reward, flags) == (total, ends)
            told["telemetry"][PAY] = paid
            assert info["telemetry"].tobytes() == told["telemetry"].tobytes()
            *terms, shown = paid.tolist()
            assert shown == total
            rounding = skip * len(terms) * np.finfo(float).eps * np.abs(terms).sum()
            assert sum(terms) == pytest.approx(total, rel=0.0, abs=rounding)
            ended = any(flags)
        endings += ended
    assert endings > 0  # not all: some arms stand still


@pytest.mark.parametrize("skip", [1, 3])
def test_a_policy_decides_at_its_training_frame_skip(skip: int) -> None:
    def noted(seen: list[Any]) -> Any:
        def act(obs: Any) -> Any:
            seen.append(obs)
            return np.full((len(obs), 4), 0.25 * len(seen), np.float32)

        return act

    env: Any = gymnasium.make(ID, frame_skip=skip, action_unit="volt")
    asked: list[Any] = []
    ran = run(
        Batch(BASELINE, PathFollowing(), 2), from_actions(noted(asked), env), [3, 4], [18, 18]
    ).telemetry
    acting = pter_gym.load_policy(from_actions(noted([]), env), env)
    obs, _ = env.reset(seed=3)
    acting.reset()
    for k in range(18 // skip):
        assert obs.tobytes() == asked[k][0].tobytes()
        obs, *_, info = env.step(acting(obs))
        rows = ran[k * skip + 1 : (k + 1) * skip + 1, 0]
        expected = rows[-1].copy()
        expected[PAY] = reduce(np.add, rows[:, PAY])
        assert info["telemetry"].tobytes() == expected.tobytes()
    assert len(asked) == 18 // skip


def test_a_law_may_decide_less_often_than_the_kernel_asks_it() -> None:
    batch = Batch(BASELINE, PathFollowing(), 1)
    law = replace(bind(Impedance(), BASELINE, batch.layout), frame_skip=5)
    volts = run(batch, law, [1], [50]).telemetry[1:, 0][:, [*COLUMN.volts]]
    changes = np.flatnonzero(np.diff(volts, axis=0).any(axis=1)) + 1
    assert len(changes) > 3
    assert (changes % 5 == 0).all()


def digest() -> str:
    """Hash what four worlds do under given actions, and under laws called from Python."""
    batch = Batch(machines(4), tasks(4))
    content = hashlib.sha256()
    for law in (None, TorqueFeedback(), Random(seed=9)):
        policy = law and Acting(law.bind(BASELINE, batch.layout))
        obs, _ = batch.reset([1, 2, 3, 4])
        for row in actions(4)[:8]:
            returns = batch.step(policy(obs) if policy else row, SKIP)
            obs = returns.obs
            content.update(obs.tobytes() + returns.telemetry.tobytes() + returns.flags.tobytes())
    return content.hexdigest()


@pytest.mark.parametrize(
    "setting", [pytest.param("", marks=pytest.mark.long), "NUMBA_DISABLE_JIT=1"]
)
def test_another_process_has_the_same_bits(setting: str) -> None:
    folder = str(Path(__file__).parents[1])
    code = (
        f"import sys; sys.path.insert(0, {folder!r}); "
        "from conformance import test_bits; print(test_bits.digest())"
    )
    command = ["env", *filter(None, [setting]), sys.executable, "-c", code]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == digest()


def test_a_control_period_has_equal_substeps_no_longer_than_the_machines() -> None:
    """As a machine whose substep divides the period has them, bit by bit."""
    task = PathFollowing(control_period=0.004)
    odd, even = (Batch(replace(BASELINE, substep=substep), task, 3) for substep in (2.5e-3, 2e-3))
    for batch in (odd, even):
        batch.reset([1, 2, 3])
    for row in np.random.default_rng(0).uniform(0.0, 8.0, (20, 3, 4)):
        mine, theirs = odd.step(row), even.step(row)
        assert mine.obs.tobytes() == theirs.obs.tobytes()
        assert mine.telemetry[0].tobytes() == theirs.telemetry[0].tobytes()


def test_recorded_forces_are_felt_at_their_instants_and_the_last_ones_ever_after() -> None:
    hand = RecordedForces(times=(0.0, 0.01, 0.02), along=(1.0, 3.0, -2.0), across=(0.0, 5.0, 1.0))
    batch = Batch(
        BASELINE, PathFollowing(path=Line(x=-0.2, y=0.55, direction=0.0, length=0.4), hand=hand)
    )
    batch.reset([0])
    rows = np.array([batch.step(np.zeros((1, 4))).telemetry[0, 0] for _ in range(4)])
    felt = rows[:, [TELEMETRY.index("force_x"), TELEMETRY.index("force_y")]]
    np.testing.assert_allclose(felt, [[3.0, 5.0], [-2.0, 1.0], [-2.0, 1.0], [-2.0, 1.0]], rtol=1e-9)
