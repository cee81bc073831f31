"""A world has the same bits alone, in a batch of any size, on any number of threads, in any place, after a checkpoint.

All through ``gymnasium.make`` and ``gymnasium.make_vec``, over automatic resets; Gymnasium's own vector environment
is the reference for what is returned.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import pter_gym  # noqa: F401  (registers the environment)
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Machine
from pter_gym.paths import Arc, Line, Sine
from pter_gym.tasks.path_following import PathFollowing, Sensing

ID = "PTER/PathFollowing-v0"
NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
STEPS = 210
LIMIT = 45
ALONE = 64
THREADED = 1100  # more than INLINE_BLOCKS blocks, the last of them not full

Record = dict[str, np.ndarray]


def machines(count: int) -> list[Machine]:
    """Different materials, time constants and kinds of lag."""
    materials = (BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL)
    kinds = [
        replace(material, clutch=replace(material.clutch, time_constant=time_constant, lag=lag))
        for material in materials
        for time_constant in (0.03, 0.105)
        for lag in ("normal_force", "voltage")
    ]
    return [kinds[k % len(kinds)] for k in range(count)]


def tasks(count: int) -> list[PathFollowing]:
    """Different paths, hands and starts."""
    kinds = [
        PathFollowing(start_offset=0.01, hand=MultiSineHand(random_phases=True)),
        PathFollowing(start_offset=0.02, hand=MultiSineHand(push=90.0, random_phases=True)),
        PathFollowing(start_offset=0.005, path=Line(x=-0.1, y=0.5, direction=0.1, length=0.2)),
        PathFollowing(start_offset=0.015, error_max=0.02, hand=MultiSineHand(random_phases=True)),
        PathFollowing(hand=MultiSineHand(push=30.0)),
        PathFollowing(
            path=Arc(x=-0.3, y=0.6, radius=0.3, angle=-1.0),
            hand=HumanArm(random_phases=True),
            error_max=0.1,
            sensing=Sensing(angle_resolution=1e-3, velocity_noise=0.01, torque_noise=0.1, force_noise=0.1, delay=1),
        ),
        PathFollowing(
            path=Sine(x=-0.5, y=0.65, extent=0.8, amplitude=0.04),
            hand=RecordedForces(times=(0.0, 0.013, 0.3), along=(40.0, 60.0, 80.0), across=(0.0, 9.0, -9.0)),
            error_max=0.1,
            friction_drift=0.1,
        ),
    ]
    return [kinds[k % len(kinds)] for k in range(count)]


def seeds(count: int) -> list[int]:
    return [17 * k + 3 for k in range(count)]


@cache
def actions(count: int, steps: int = STEPS) -> np.ndarray:
    """Random voltages (steps, count, 4), half of them zero; those of a world do not depend on how many there are."""
    drawn = np.random.default_rng(7).random((count, STEPS, 8), np.float32)[:, :steps]
    return np.ascontiguousarray((24.0 * drawn[..., :4] * (drawn[..., 4:] < 0.5)).swapaxes(0, 1))


def make(count: int, mode: AutoresetMode, order: Sequence[int] | None = None, **options: Any) -> Any:
    """Worlds of all kinds through ``gymnasium.make_vec``, in their order or another one."""
    order = range(count) if order is None else order
    all_machines, all_tasks = machines(count), tasks(count)
    return gymnasium.make_vec(
        ID,
        num_envs=count,
        machine=[all_machines[k] for k in order],
        task=[all_tasks[k] for k in order],
        autoreset_mode=mode,
        max_episode_steps=LIMIT,
        **options,
    )


def live(env: Any, given: Sequence[int] | None, voltages: np.ndarray) -> Iterator[Record]:
    """Reset, unless ``given`` is None, and step; yield what came out, world by world, in the form of SAME_STEP."""
    if given is not None:
        obs, infos = env.reset(seed=list(given))
        yield {"obs": obs, "telemetry": infos["telemetry"]}
    for rows in voltages:
        obs, rewards, terminated, truncated, infos = env.step(rows)
        ended = terminated | truncated
        final_obs = np.zeros_like(obs)
        final_telemetry = np.zeros_like(infos["telemetry"])
        success, telemetry = infos["is_success"], infos["telemetry"]
        if env.metadata["autoreset_mode"] == SAME_STEP and ended.any():
            final_obs[ended] = np.stack(infos["final_obs"][ended])
            final_telemetry[ended] = infos["final_info"]["telemetry"][ended]
            success = success | infos["final_info"]["is_success"]
        elif env.metadata["autoreset_mode"] == DISABLED and ended.any():
            final_obs[ended] = obs[ended]
            final_telemetry[ended] = telemetry[ended]
            obs, infos = env.reset(options={"reset_mask": ended})
            telemetry = np.where(ended[:, None], infos["telemetry"], telemetry)
        yield {
            "obs": obs,
            "telemetry": telemetry,
            "rewards": rewards,
            "terminated": terminated,
            "truncated": truncated,
            "success": success,
            "final_obs": final_obs,
            "final_telemetry": final_telemetry,
        }


def live_alone(world: int, mode: AutoresetMode) -> Iterator[Record]:
    """The same of one world in an environment of its own, which is reset with its seed and then without."""
    env = gymnasium.make(ID, machine=machines(world + 1)[-1], task=tasks(world + 1)[-1], max_episode_steps=LIMIT)
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
        yield {
            "obs": obs,
            "telemetry": info["telemetry"],
            "rewards": np.float64(reward),
            "terminated": np.bool_(terminated),
            "truncated": np.bool_(truncated),
            "success": np.bool_(success),
            "final_obs": final_obs,
            "final_telemetry": final_telemetry,
        }


@cache
def alone(mode: AutoresetMode) -> list[Record]:
    """The records of all single worlds, put together."""
    lives = [list(live_alone(world, mode)) for world in range(ALONE)]
    return [
        {name: np.stack([record[name] for record in records]) for name in records[0]}
        for records in zip(*lives, strict=True)
    ]


def require_same(one: Record, two: Record, step: int) -> None:
    """Compare two records, bit for bit."""
    assert one.keys() == two.keys()
    for name, values in one.items():
        assert values.dtype == two[name].dtype, (name, step)
        assert values.tobytes() == two[name].tobytes(), (name, step)


def rows(record: Record, chosen: Any) -> Record:
    return {name: values[chosen] for name, values in record.items()}


def test_episodes_of_the_single_worlds_end_in_every_way() -> None:
    records = alone(SAME_STEP)[1:]
    terminated, truncated, success = (
        np.array([record[name] for record in records]) for name in ("terminated", "truncated", "success")
    )
    assert (success & terminated).sum() > 20
    assert (terminated & ~success).sum() > 20
    assert (truncated & ~terminated).sum() > 20
    per_step = (terminated | truncated).sum(axis=1)
    assert 0 < np.count_nonzero(per_step) < STEPS
    assert per_step.max() < ALONE


@pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("count", [7, 64])
def test_a_row_of_a_batch_is_a_single_environment(count: int, mode: AutoresetMode) -> None:
    env = make(count, mode)
    for step, record in enumerate(live(env, seeds(count), actions(count))):
        require_same(record, rows(alone(mode)[step], slice(count)), step)


@pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
def test_any_number_of_threads(mode: AutoresetMode) -> None:
    envs = [make(THREADED, mode, num_threads=threads) for threads in (1, 3)]
    lives = zip(*(live(env, seeds(THREADED), actions(THREADED)) for env in envs), strict=True)
    for step, (one, *others) in enumerate(lives):
        require_same(rows(one, slice(ALONE)), alone(mode)[step], step)
        for other in others:
            require_same(one, other, step)


def test_any_order_of_worlds() -> None:
    count = THREADED
    order = np.random.default_rng(1).permutation(count)
    env = make(count, SAME_STEP)
    turned = make(count, SAME_STEP, list(order))
    turned_seeds = [seeds(count)[k] for k in order]
    lives = zip(
        live(env, seeds(count), actions(count)), live(turned, turned_seeds, actions(count)[:, order]), strict=True
    )
    for step, (one, two) in enumerate(lives):
        require_same(rows(one, order), two, step)


@pytest.mark.parametrize(
    ("count", "half", "mode"), [*((64, 57, mode) for mode in AutoresetMode), (THREADED, 101, SAME_STEP)]
)
def test_after_a_checkpoint(count: int, half: int, mode: AutoresetMode) -> None:
    env = make(count, mode)
    voltages = actions(count)
    for _ in live(env, seeds(count), voltages[:half]):
        pass
    state = env.get_state()
    expected = list(live(env, None, voltages[half:]))
    other = make(count, mode, num_threads=3)
    other.reset(seed=123)
    for again in (other, env):
        again.set_state(state)
        for step, (one, two) in enumerate(zip(expected, live(again, None, voltages[half:]), strict=True)):
            require_same(one, two, step)


@pytest.mark.parametrize("name", ["worlds", "words", "seeded"])
def test_a_wrong_checkpoint_is_refused_and_nothing_changes(name: str) -> None:
    env = make(64, SAME_STEP)
    env.reset(seed=0)
    before = env.get_state()
    good = make(64, SAME_STEP)
    good.reset(seed=1)
    for wrong in (None, "text", good.get_state()[name][:-1], good.get_state()[name].astype(np.float32)):
        with pytest.raises(ValueError, match=name):
            env.set_state({**good.get_state(), name: wrong})
        require_same(env.get_state(), before, 0)


def test_an_end_at_the_limit_is_both_terminated_and_truncated_as_with_time_limit() -> None:
    def first_end(env: Any, action: np.ndarray) -> list[Any]:
        env.reset(seed=0)
        for step in range(1, 1000):
            flags = [np.ravel(part)[0].item() for part in env.step(action)[2:4]]
            if any(flags):
                return [step, *flags]
        raise AssertionError("no end")

    zero = np.zeros(4, np.float32)
    step, terminated, truncated = first_end(gymnasium.make(ID), zero)
    assert (terminated, truncated) == (True, False)
    for limit, flags in ((step - 1, [False, True]), (step, [True, True]), (step + 1, [True, False])):
        alone_end = first_end(gymnasium.make(ID, max_episode_steps=limit), zero)
        batch_end = first_end(gymnasium.make_vec(ID, num_envs=1, max_episode_steps=limit), zero[None])
        assert batch_end == alone_end == [min(step, limit), *flags]


def told(infos: dict[str, Any]) -> dict[str, Any]:
    """What infos tell where their masks are set, and the masks."""
    out: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_"):
            out[key] = value.tolist()
        elif isinstance(value, dict):
            out[key] = told(value)
        else:
            chosen = infos[f"_{key}"]
            part = np.stack(value[chosen]) if value.dtype == object else value[chosen]
            out[key] = (value.dtype, part.dtype, part.shape, part.tobytes())
    return out


@pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
def test_returns_are_those_of_gymnasiums_own_vector_environment(mode: AutoresetMode) -> None:
    options: dict[str, Any] = {"task": tasks(1)[0], "max_episode_steps": LIMIT}
    ours: Any = gymnasium.make_vec(ID, num_envs=7, autoreset_mode=mode, **options)
    theirs: Any = gymnasium.make_vec(
        ID, num_envs=7, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options
    )
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    one, two = ours.reset(seed=5), theirs.reset(seed=5)
    for step, row in enumerate(actions(7)):
        assert len(one) == len(two)
        for part, other in zip(one[:-1], two[:-1], strict=True):
            assert (part.dtype, part.tobytes()) == (other.dtype, other.tobytes()), step
        assert told(one[-1]) == told(two[-1]), step
        if mode == DISABLED and len(one) == 5 and (one[2] | one[3]).any():
            mask = one[2] | one[3]
            one, two = ours.reset(options={"reset_mask": mask}), theirs.reset(options={"reset_mask": mask})
        else:
            one, two = ours.step(row), theirs.step(row)
