"""A machine of one's own in a scenario: the same paths and hands, nobody else's machine, and its delay."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import pter_gym  # noqa: F401 - registers the ids
from pter_gym.benchmark import Examination
from pter_gym.controllers import TorqueFeedback, bind
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, machine_of
from pter_gym.params._preset import PRESET, Preset, format_preset
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.scenarios._own_machine import OwnMachine, as_sensed, find_own
from pter_gym.scenarios.randomisation import OneOf, Vary
from pter_gym.tasks.path_following import PathFollowing, Sensing

OWN = replace(
    PRESET, arm=replace(PRESET.arm, inertia_a=0.7), clutch=replace(PRESET.clutch, scale=(0.9, 1.1, 1.05, 0.95))
)


def late(preset: Preset, delay: float) -> Preset:
    return replace(preset, sensing=replace(preset.sensing, delay=delay))


@pytest.fixture
def preset(tmp_path: Path) -> str:
    path = tmp_path / "own.toml"
    path.write_text(format_preset(late(OWN, 0.012), "own"), "utf-8")
    return str(path)


@pytest.mark.parametrize("name", SCENARIOS)
def test_all_else_is_drawn_as_without_it(name: str, preset: str) -> None:
    drawn = find_scenario(name).randomisation("slow", contexts=40, seed=3).pairs()
    own = find_scenario(name, preset).randomisation("slow", contexts=40, seed=3).pairs()
    assert {machine for machine, _ in own} == {machine_of(OWN)}
    assert {task.sensing.delay for _, task in own} == {1}
    for (_, theirs), (_, mine) in zip(drawn, own, strict=True):
        assert replace(mine, sensing=replace(mine.sensing, delay=theirs.sensing.delay)) == theirs


def test_a_machine_is_given_by_itself_its_name_or_its_preset(preset: str) -> None:
    assert find_own("delrin_experimental") == find_own(DELRIN_EXPERIMENTAL) == OwnMachine(DELRIN_EXPERIMENTAL)
    assert find_own(preset) == find_own(find_own(preset)) == OwnMachine(machine_of(OWN), 0.012)
    with pytest.raises(ParameterError, match="did you mean 'delrin_experimental'"):
        find_scenario("standard", "delrin_experimentel")
    with pytest.raises(ParameterError, match=r"OwnMachine\.delay must be"):
        OwnMachine(BASELINE, -0.01)
    with pytest.raises(ParameterError, match=r"OwnMachine\.machine must be of type Machine"):
        OwnMachine("baseline")  # type: ignore[arg-type]


def test_more_delay_than_a_task_can_have_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"must be at most 2 control steps of 0\.01 s, got 0\.03 s"):
        find_scenario("paths", OwnMachine(BASELINE, 0.03))


def test_what_draws_the_sensors_keeps_all_but_the_delay() -> None:
    few, many = Sensing(velocity_noise=0.1, delay=1), Vary(Sensing(), delay=OneOf((0, 2)))
    task = Vary(PathFollowing(), sensing=OneOf((few, many)))
    sensed: Any = as_sensed(task, OwnMachine(BASELINE, 0.02))
    rng = np.random.default_rng(0)
    drawn = {sensed.draw(rng).sensing for _ in range(30)}
    assert drawn == {replace(few, delay=2), Sensing(delay=2)}
    early: Any = as_sensed(task, OwnMachine(BASELINE, 0.004))
    assert {early.draw(rng).sensing.delay for _ in range(30)} == {0}
    assert as_sensed(task, OwnMachine(BASELINE)) is task


def test_the_registered_environments_take_it(preset: str) -> None:
    many: Any = gymnasium.make_vec("PTER/Everything-v0", num_envs=3, machine=preset, contexts=5)
    one: Any = gymnasium.make("PTER/Everything-v0", machine=preset, contexts=5)
    for batch in (many.batch, one.unwrapped.batch):
        assert {machine for machine, _ in batch.pairs} == {machine_of(OWN)}
        assert {task.sensing.delay for _, task in batch.pairs} == {1}
    with pytest.raises(ParameterError, match="machine must be"):
        gymnasium.make("PTER/Standard-v0", machine=3)


def test_a_law_is_told_of_it(preset: str) -> None:
    """The voltages of a torque law follow from the torque curves that it believes."""
    own, scenario = machine_of(OWN), find_scenario("standard", preset)
    assert scenario.nominal == own
    assert find_scenario("standard").nominal == BASELINE
    exam, law = Examination("standard", "slow", 4, 5, preset), TorqueFeedback(feedback=0.5)
    layout = exam.batch.layout
    assert exam.judge(law) == exam.judge(bind(law, own, layout))
    other = replace(own, clutch=DELRIN_EXPERIMENTAL.clutch)
    assert exam.judge(law) != exam.judge(bind(law, other, layout))
