"""A compiled law that returns what is no voltage is refused, and nothing has moved."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from pter_gym._compiled.records import rows
from pter_gym._engine.batch import Batch
from pter_gym._engine.law import empty_memory
from pter_gym.controllers import PerClutch, Policy, device
from pter_gym.errors import ActionError, LawIndexError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing

TASK = PathFollowing(start_offset=0.01)
STEP, WORLD, VALUE = range(3)


class Kept(NamedTuple):
    """What the law below keeps of a world: a record of its own."""

    world: float
    steps: float
    unused: float


KEPT = rows(Kept)


@device
def fails_later(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Hold clutch 4, and from a step on return a value as the voltage of clutch 2, in the worlds from one on."""
    memory[KEPT.steps] += 1.0
    fails = memory[KEPT.steps] > gains[STEP] and memory[KEPT.world] >= gains[WORLD]
    return PerClutch(0.0, gains[VALUE] if fails else 1.0, 0.0, 24.0)


def compile_law() -> None:
    """Compile the law into what rolls it out, as the tests below call it."""
    batch = Batch(BASELINE, TASK, 1)
    obs, _ = batch.reset([0])
    gains, memory = np.array([9.0, 0.0, 0.0]), empty_memory(1, Kept)
    batch.rollout(obs, fails_later, gains, 1, memory)


def states(batch: Batch, memory: np.ndarray) -> bytes:
    return b"".join(part.tobytes() for part in (*batch.get_state().values(), memory))


@pytest.mark.parametrize(("count", "threads"), [(70, 1), (2000, 3)])
@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_a_number_that_is_not_finite_is_refused_and_nothing_has_moved(
    count: int, threads: int, value: float
) -> None:
    batch = Batch(BASELINE, TASK, count, num_threads=threads)
    obs, _ = batch.reset(range(count))
    memory = empty_memory(count, Kept)
    obs, _ = batch.rollout(obs, fails_later, np.array([9.0, 0.0, 0.0]), 5, memory)
    before, seen = states(batch, memory), obs.tobytes()
    gains = np.array([7.0, count // 2, value])
    with pytest.raises(ActionError, match=f"world {count // 2} "):
        batch.rollout(obs, fails_later, gains, 20, memory)
    assert states(batch, memory) == before
    assert obs.tobytes() == seen
    batch.rollout(obs, fails_later, gains, 2, memory)  # the steps before it go well
    batch.close()


def test_a_voltage_beyond_the_range_is_clipped() -> None:
    rows = []
    for value in (1e300, -5.0, BASELINE.clutch.voltage_max, 0.0):
        batch = Batch(BASELINE, TASK, 2)
        obs, _ = batch.reset([0, 1])
        rows.append(
            batch.rollout(obs, fails_later, np.array([3.0, 0.0, value]), 8, empty_memory(2, Kept))[
                1
            ]
        )
    np.testing.assert_array_equal(rows[0], rows[2])
    np.testing.assert_array_equal(rows[1], rows[3])
    assert not np.array_equal(rows[0], rows[1])


def test_a_policy_keeps_the_record_that_its_law_declares() -> None:
    batch = Batch(BASELINE, TASK, 3)
    obs, _ = batch.reset([0, 1, 2])
    policy = Policy(np.array([1.0, 1.0, 5.0]), batch.layout, law=fails_later, memory=Kept)
    assert policy.empty_memory(3).tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    for volts in ([1.0, 1.0, 1.0], [1.0, 5.0, 5.0]):  # the law counts steps, and knows its world
        assert policy(obs)[:, 1].tolist() == volts
    policy.reset()
    assert policy(obs)[:, 1].tolist() == [1.0, 1.0, 1.0]


@device
def helper(obs: Any) -> float:
    return obs[40]


@device
def counted(memory: Any) -> int:
    memory[0] += 1.0
    return int(memory[0])


def beyond(kind: str) -> Any:
    """A law with a mistake."""

    @device
    def law(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return {
            "obs": lambda: PerClutch(obs[40], 0.0, 0.0, 0.0),
            "gains": lambda: PerClutch(gains[7], 0.0, 0.0, 0.0),
            "branch": lambda: PerClutch(obs[40] if obs[3] > 0.5 else 0.0, 0.0, 0.0, 0.0),
            "division": lambda: PerClutch(1.0 / math.floor(obs[3]) + obs[40], 0.0, 0.0, 0.0),
            "counter": lambda: PerClutch(memory[counted(memory)], 0.0, 0.0, 0.0),
            "helper": lambda: PerClutch(helper(obs), 0.0, 0.0, 0.0),
            "memory": lambda: memory.__setitem__(9, 1.0),
            "name": lambda: PerClutch(obs[KEPT.stps], 0.0, 0.0, 0.0),  # type: ignore[attr-defined]
            "result": lambda: (0.0, 0.0, 0.0, 0.0),
            "text": lambda: PerClutch("a", 0.0, 0.0, 0.0),  # type: ignore[arg-type]
            "array": lambda: PerClutch(obs, 0.0, 0.0, 0.0),
        }[kind]()

    return law


@device
def three_arguments(obs: Any, scales: Any, gains: Any) -> PerClutch:
    return PerClutch(0.0, 0.0, 0.0, 0.0)


NO_INDEX = ("name", "result", "text", "array")


@pytest.mark.parametrize(
    "kind", ["obs", "gains", "branch", "division", "counter", "helper", "memory", *NO_INDEX]
)
def test_a_mistake_in_a_law_gives_a_one_line_error_before_compilation(kind: str) -> None:
    batch = Batch(BASELINE, TASK, 3)
    obs, _ = batch.reset([0, 1, 2])
    error = ParameterError if kind in NO_INDEX else LawIndexError
    for run in (
        lambda: Policy(np.zeros(1), batch.layout, law=beyond(kind)),
        lambda: batch.rollout(obs, beyond(kind), np.zeros(1), 1),
    ):
        with pytest.raises(error, match="law") as raised:
            run()
        assert "\n" not in str(raised.value)
    with pytest.raises(ParameterError, match="three_arguments"):
        Policy(np.zeros(1), batch.layout, law=three_arguments)
