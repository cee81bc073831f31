"""Scenarios and what worlds draw: from the seed alone, the same through every door."""

import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import pter_gym
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW, SAME_STEP
from pter_gym.errors import ParameterError
from pter_gym.hands import HumanArm, MultiSineHand
from pter_gym.params import BASELINE, Hand
from pter_gym.paths import Arc
from pter_gym.scenarios import PACES, SCENARIOS, find_pace, find_scenario
from pter_gym.scenarios.randomisation import LogUniform, OneOf, Randomisation, Repeat, Shared, Tuple, Uniform, Vary
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tasks.path_following._context import CONTEXT_WIDTH, TOLD
from pter_gym.tasks.path_following._observation import BOUND


def test_each_scenario_is_registered_under_its_id() -> None:
    ids = {name for name in gymnasium.registry if name.startswith("PTER/")}
    assert ids == {scenario.id for scenario in SCENARIOS.values()} | {"PTER/PathFollowing-v0"}
    assert pter_gym.__version__


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=lambda scenario: scenario.name)
def test_gymnasiums_checker_has_nothing_to_say(scenario: Any) -> None:
    env = gymnasium.make(scenario.id, pace="medium", contexts=8, action_unit="normalised", observe_context=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=lambda scenario: scenario.name)
def test_a_row_of_a_batch_lives_the_episodes_of_a_single_environment(scenario: Any) -> None:
    options: dict[str, Any] = {"contexts": 16, "observe_context": True, "sensors": "force", "action_unit": "volt"}
    many: Any = gymnasium.make_vec(scenario.id, num_envs=70, autoreset_mode="SameStep", num_threads=2, **options)
    alone = gymnasium.make(scenario.id, **options)
    rng = np.random.default_rng(5)
    first, infos = many.reset(seed=100)
    obs, info = alone.reset(seed=166)
    for _ in range(150):
        assert obs.tobytes() == first[66].tobytes()
        assert info["telemetry"].tobytes() == infos["telemetry"][66].tobytes()
        actions = rng.uniform(0.0, 6.0, (70, 4)).astype(np.float32)
        first, rewards, _, _, infos = many.step(actions)
        obs, reward, terminated, truncated, info = alone.step(actions[66])
        assert reward == rewards[66]
        if terminated or truncated:
            obs, info = alone.reset()


def test_draws_depend_on_the_seed_alone_and_reach_every_pair() -> None:
    pairs = SCENARIOS["everything"].randomisation(contexts=40).pairs()
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks, 900, draws=True)
    batch.reset(list(range(900)))
    context = np.array(batch.context)
    assert set(context) == set(range(40))
    assert np.bincount(context).max() < 22.5 + 6.0 * np.sqrt(22.5)
    order = np.random.default_rng(0).permutation(900)
    other = Batch(machines, tasks, 900, draws=True, num_threads=3)
    other.reset(order.tolist())
    np.testing.assert_array_equal(np.array(other.context), context[order])
    for _ in range(40):
        batch.step(np.zeros((900, 4)), SAME_STEP)
    assert (np.array(batch.context) != context).mean() > 0.5


def test_the_telemetry_and_the_observation_tell_the_context() -> None:
    pairs = SCENARIOS["materials"].randomisation(contexts=10).pairs()
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks, observe_context=True)
    obs, rows = batch.reset([0] * 10)
    told = rows[:, -len(TOLD) :]
    np.testing.assert_array_equal(told[:, 0], [machine.clutch.time_constant for machine in machines])
    top = BASELINE.clutch.voltage_max
    for machine, row in zip(machines, told, strict=True):
        expected = (
            np.mean(machine.clutch_scale) * machine.clutch.dynamic.torque(top) / BASELINE.clutch.dynamic.torque(top)
        )
        assert row[2] == pytest.approx(expected, rel=1e-12)
    scaled = np.clip(told / TOLD.scales, -BOUND, BOUND)
    np.testing.assert_allclose(obs[:, -len(TOLD) :], scaled, rtol=1e-6)
    assert batch.layout.names[-len(TOLD) :] == TOLD.names


def test_the_same_seed_gives_the_same_pairs() -> None:
    scenario = SCENARIOS["everything"]
    one, two, other = (scenario.randomisation(contexts=12, seed=seed).pairs() for seed in (3, 3, 4))
    assert one == two
    assert all(pair not in other for pair in one)


def test_distributions_stay_within_their_ends() -> None:
    rng = np.random.default_rng(0)
    for distribution in (Uniform(-1.0, 2.0), LogUniform(0.1, 10.0)):
        draws = [distribution.draw(rng) for _ in range(2000)]
        low, high = distribution.extremes()
        assert low <= min(draws) < max(draws) <= high
        assert min(draws) - low < 0.02 * (high - low)
    shared = Shared(Uniform(2.0, 3.0), Uniform(0.9, 1.1), 4)
    ratios = [max(t) / min(t) for t in (shared.draw(rng) for _ in range(500))]
    assert max(ratios) <= 1.1 / 0.9
    assert {OneOf((1, Uniform(2.0, 2.0))).draw(rng) for _ in range(50)} == {1, 2.0}
    assert Repeat(Uniform(1.0, 1.0), 3).draw(rng) == (1.0,) * 3
    assert Tuple((Uniform(1.0, 1.0), OneOf(("x",)))).draw(rng) == (1.0, "x")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Uniform(1.0, 0.0), r"Uniform\.high must be"),
        (lambda: LogUniform(0.0, 1.0), r"LogUniform\.low must be"),
        (lambda: OneOf(()), r"OneOf\.options"),
        (lambda: Vary(BASELINE.arm, inertia_a=Uniform(-0.1, 1.0)), r"Arm\.inertia_a must be"),
        (lambda: Vary(BASELINE.arm, inertia=Uniform(0.1, 1.0)), r"Arm has no field 'inertia'"),
        (lambda: Vary(BASELINE.clutch, time_constant=Uniform(0.0, 1.0)), r"Clutch\.time_constant must be"),
        (lambda: Vary(BASELINE, clutch_scale=Repeat(Uniform(-1.0, 1.0), 4)), r"Machine\.clutch_scale must be"),
        (
            lambda: Vary(HumanArm(), impedance=Vary(Hand(mass=1.0, stiffness=1.0), stiffness=Uniform(0.0, 9.0))),
            r"impedance\.stiffness must be",
        ),
        (lambda: Vary(PathFollowing(), pace=Uniform(0.1, 9.0)), r"PathFollowing\.pace must be"),
        (lambda: Randomisation(task=PathFollowing(), contexts=0), r"Randomisation\.contexts must be"),
    ],
)
def test_what_could_draw_something_impossible_is_refused_when_it_is_built(make: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()


def test_a_randomisation_whose_paths_all_leave_the_reach_is_refused() -> None:
    far = Vary(PathFollowing(), path=Vary(Arc(), y=Uniform(3.0, 4.0)))
    with pytest.raises(ParameterError, match="within reach"):
        Randomisation(task=far, contexts=1).pairs()


def test_unknown_names_are_told_the_nearest() -> None:
    with pytest.raises(ParameterError, match=r"did you mean 'materials'\?"):
        find_scenario("material")
    with pytest.raises(ParameterError, match=r"did you mean 'medium'\?"):
        find_pace("mediums")
    with pytest.raises(ParameterError, match="scenario must be among"):
        gymnasium.make("PTER/Paths-v0", scenario="path")
    assert find_pace("slow") == PACES["slow"]


def test_a_randomisation_stands_alone() -> None:
    drawn = SCENARIOS["standard"].randomisation(contexts=2)
    with pytest.raises(ParameterError, match="task and machine must not be given with a randomisation"):
        gymnasium.make("PTER/PathFollowing-v0", randomisation=drawn, task=PathFollowing())


def test_the_truth_of_a_world_is_its_state_and_its_machine_and_task() -> None:
    other = replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=0.05))
    batch = Batch([BASELINE, other, BASELINE], PathFollowing(hand=MultiSineHand(random_phases=True)))
    batch.reset([0, 1, 0])
    first = batch.truth()
    assert first.shape[0] == 3
    assert np.isfinite(first).all()
    differing = first[0] != first[1]
    assert 5 <= differing.sum() < 40, "sines, where the context begins, and what follows from the time constant"
    batch.step(np.full((3, 4), 7.0))
    after = batch.truth()
    changed = (after != first).any(axis=0)
    assert changed.sum() > 8
    context = first.shape[1] - CONTEXT_WIDTH
    assert not changed[context:].any()
    assert differing[context:].any()


def test_a_state_of_other_machines_is_refused() -> None:
    """A state says where a world's constants begin; a state that points elsewhere must not be followed."""
    batch = Batch([BASELINE, replace(BASELINE, clutch_scale=(0.9,) * 4)], PathFollowing())
    batch.reset([0, 1])
    state = batch.get_state()
    for row, value in ((ROW.context_at, 1e9), (ROW.foot.segment, 7.0), (ROW.step, -1.0), (ROW.step, np.nan)):
        broken = {**state, "worlds": state["worlds"].copy()}
        broken["worlds"][0, row, 0] = value
        with pytest.raises(ParameterError, match=r"state\['worlds'\]"):
            batch.set_state(broken)
    batch.set_state(state)
