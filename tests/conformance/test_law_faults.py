"""What goes wrong in a compiled law is an error of one line, whenever it comes."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from pter_gym._compiled.records import rows
from pter_gym._engine.batch import Batch
from pter_gym.controllers import PerClutch, Policy, compiled
from pter_gym.errors import ActionError, LawIndexError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing
from rollouts import simulate

TASK = PathFollowing(start_offset=0.01)
STEP, EPISODE, VALUE = range(3)


class Kept(NamedTuple):
    """What the law below keeps of a world: a record of its own."""

    episode: float
    steps: float
    unused: float


KEPT = rows(Kept)


@compiled
def fails_later(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Hold clutch 4; from a step on, in worlds from one on, return a value for clutch 2."""
    memory[KEPT.steps] += 1.0
    fails = memory[KEPT.steps] > gains[STEP] and memory[KEPT.episode] >= gains[EPISODE]
    return PerClutch(0.0, gains[VALUE] if fails else 1.0, 0.0, 24.0)


def run_law(law: Any, gains: Any, *, worlds: int = 2, steps: int = 8) -> np.ndarray:
    batch = Batch(BASELINE, TASK, worlds)
    policy = Policy.from_law(law, gains, BASELINE, batch.layout, memory=Kept)
    return simulate(batch, policy, range(worlds), steps)


@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_a_number_that_is_not_finite_is_refused(value: float) -> None:
    with pytest.raises(ActionError, match="world 35 "):
        run_law(fails_later, [7.0, 35, value], worlds=70, steps=20)
    run_law(fails_later, [7.0, 35, value], worlds=70, steps=7)  # the steps before it go well


def test_a_voltage_beyond_the_range_is_clipped() -> None:
    values = (1e300, -5.0, BASELINE.clutch.voltage_max, 0.0)
    rows = [run_law(fails_later, [3.0, 0.0, value]) for value in values]
    np.testing.assert_array_equal(rows[0], rows[2])
    np.testing.assert_array_equal(rows[1], rows[3])
    assert not np.array_equal(rows[0], rows[1])


def test_a_policy_keeps_the_record_that_its_law_declares() -> None:
    batch = Batch(BASELINE, TASK, 3)
    obs, _ = batch.reset([0, 1, 2])
    gains = [1.0, 1.0, 5.0]
    policy = Policy.from_law(fails_later, gains, BASELINE, batch.layout, memory=Kept)
    assert policy.start(3).tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    memory = policy.start(2, [7, 9])
    assert memory[:, KEPT.episode].tolist() == [7.0, 9.0]
    memory = policy.start(3)
    for volts in ([1.0, 1.0, 1.0], [1.0, 5.0, 5.0]):  # the law counts steps, and its episode
        assert policy.act(obs, memory)[:, 1].tolist() == volts
    assert policy.act(obs, policy.start(3))[:, 1].tolist() == [1.0, 1.0, 1.0]


@compiled
def helper(obs: Any) -> float:
    return obs[40]


@compiled
def counted(memory: Any) -> int:
    memory[1] += 1.0
    return int(memory[1])


def beyond(kind: str) -> Any:  # noqa: C901  (one law for each mistake)
    """A law with a mistake."""

    @compiled
    def obs(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(obs[40], 0.0, 0.0, 0.0)

    @compiled
    def gains(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(gains[7], 0.0, 0.0, 0.0)

    @compiled
    def branch(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(obs[40] if obs[3] != 0.5 else 0.0, 0.0, 0.0, 0.0)

    @compiled
    def division(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(1.0 / (memory[1] + 1.0) + obs[40], 0.0, 0.0, 0.0)

    @compiled
    def inner(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(helper(obs), 0.0, 0.0, 0.0)

    @compiled
    def kept(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        memory[9] = 1.0
        return PerClutch(0.0, 0.0, 0.0, 0.0)

    @compiled
    def name(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(obs[KEPT.stps], 0.0, 0.0, 0.0)  # type: ignore[attr-defined]

    @compiled
    def result(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return (0.0, 0.0, 0.0)

    @compiled
    def text(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch("a", 0.0, 0.0, 0.0)  # type: ignore[arg-type]

    @compiled
    def array(obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        return PerClutch(obs, 0.0, 0.0, 0.0)

    @compiled
    def arguments(obs: Any, scales: Any, gains: Any) -> Any:
        return PerClutch(0.0, 0.0, 0.0, 0.0)

    return locals()[kind]


KINDS = ("division", "inner", "kept")
"""Each compiles a kernel; the others differ in the array, and are found by the same check."""


@pytest.mark.parametrize(
    "kind",
    [*KINDS, *(pytest.param(each, marks=pytest.mark.long) for each in ("obs", "gains", "branch"))],
)
def test_an_index_beyond_an_array_is_an_error_of_one_line(kind: str) -> None:
    with pytest.raises(LawIndexError, match=f"law {kind}: .*memory 3") as raised:
        run_law(beyond(kind), [0.0])
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "kind",
    [
        "name",
        "result",
        *(pytest.param(each, marks=pytest.mark.long) for each in ("text", "array", "arguments")),
    ],
)
def test_a_law_that_cannot_be_compiled_is_an_error_of_one_line(kind: str) -> None:
    with pytest.raises(ParameterError, match=f"law {kind}") as raised:
        run_law(beyond(kind), [0.0])
    assert "\n" not in str(raised.value)


@compiled
def counts(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Read beyond the gains after many steps, which no trial before the run would see."""
    volts = gains[counted(memory) // 100]
    return PerClutch(volts, volts, volts, volts)


def test_an_index_that_leaves_its_array_late_is_an_error_too() -> None:
    run_law(counts, [24.0], steps=99)
    with pytest.raises(LawIndexError, match=r"law counts: .*gains 1"):
        run_law(counts, [24.0], steps=100)


def test_a_global_that_has_changed_has_effect() -> None:
    scope: dict[str, Any] = {"compiled": compiled, "PerClutch": PerClutch, "VOLTS": 1.0}
    code = """
@compiled
def strength():
    return VOLTS

@compiled
def law(obs, scales, gains, memory):
    return PerClutch(strength(), 0.0, 0.0, 0.0)
"""
    exec(code, scope)  # as in a notebook
    layout = Batch(BASELINE, TASK, 1).layout
    obs = np.zeros((1, len(layout)), np.float32)
    for volts in (1.0, 5.0):
        scope["VOLTS"] = volts
        policy = Policy.from_law(scope["law"], [0.0], BASELINE, layout)
        assert policy.act(obs, policy.start(1))[0, 0] == volts
