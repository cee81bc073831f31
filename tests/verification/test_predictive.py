"""The predictive controllers: they beat what guides them, and each knows what it says that it knows."""

from dataclasses import replace

import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import FLAG, ROW
from pter_gym.benchmark._recorded import Recorded
from pter_gym.benchmark.metrics import score
from pter_gym.benchmark.simulation import record_episode
from pter_gym.controllers import Free, SingleDof
from pter_gym.controllers._predictive import Honest, Planner, Privileged, Settings
from pter_gym.controllers._predictive.honest import Belief, ForceForecast, known_part
from pter_gym.controllers._predictive.planner import PLANS, play
from pter_gym.errors import ParameterError
from pter_gym.hands import RecordedForces
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, Machine
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensing, observation_layout
from pter_gym.tasks.path_following._observation import SEEN

GUIDE = SingleDof(damping_tangential=250.0, pace_fraction=0.75, approach=20.0, strength=150.0, slow=0.5, feedback=2.0)
FEW = Settings(samples=64, rounds=3, elite=8)
((MACHINE, TASK),) = find_scenario("standard").randomisation("brisk", contexts=1, seed=5).pairs()


def state_of(world: Batch) -> np.ndarray:
    return world.get_state()["worlds"][0, :, 0]


def pushed(across: list[float]) -> PathFollowing:
    """The task with a hand that pushes, and disturbs as recorded at each control instant."""
    times = tuple(TASK.control_period * k for k in range(len(across)))
    return replace(TASK, hand=RecordedForces(times=times, along=(60.0,) * len(across), across=tuple(across)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Privileged, Honest])
def test_it_beats_its_warm_start_and_keeps_the_pace(kind: type[Privileged | Honest]) -> None:
    """It keeps path and pace behind the first segment; a plan costs no more for a slow start."""
    settings = Settings(samples=128, rounds=4)
    telemetry = record_episode(kind(GUIDE, settings), MACHINE, TASK, 3, 600).telemetry
    found = score(telemetry, TASK)
    expected = score(record_episode(GUIDE, MACHINE, TASK, 3, 600).telemetry, TASK)
    assert found.completed
    plain, others = (max(each.mean_error_m, each.path_average_error_m) for each in (found, expected))
    assert plain < 0.8 * others
    times = Recorded(telemetry[:, None], [TASK], MACHINE.clutch.voltage_max).relative_times[1:]
    assert max(np.abs(times - 1.0).mean(), abs(times.mean() - 1.0)) < 0.15
    again = record_episode(kind(GUIDE, settings), MACHINE, TASK, 3, 20).telemetry
    np.testing.assert_array_equal(again, telemetry[:21])


@pytest.mark.slow
def test_the_best_plan_costs_no_more_than_the_guides_and_comes_true() -> None:
    world = Batch(MACHINE, TASK, 1)
    obs, _ = world.reset([1])
    planner = Planner(FEW, MACHINE, TASK, GUIDE)
    before = state_of(world)
    first = planner.decide(before, obs[0])
    assert before.tobytes() == state_of(world).tobytes()
    guided = Planner(FEW, MACHINE, TASK, GUIDE).guided(before, obs[0])
    plans = np.stack([planner.latest, guided])
    costs = planner.costs(before, obs[0], np.repeat(plans, FEW.samples // 2, axis=0))
    assert costs[0] < costs[-1]
    assert costs[0] == costs[FEW.samples // 2 - 1]
    np.testing.assert_array_equal(first, planner.latest[0])
    terms: list[float] = []
    for step in range(FEW.horizon):
        place = step / FEW.knot_steps
        volts = [np.interp(place, np.arange(FEW.knots), planner.latest[:, clutch]) for clutch in range(4)]
        returns = world.step(np.array(volts)[None])
        np.testing.assert_allclose(returns.telemetry[0, 0, [*COLUMN.volts]], volts, rtol=1e-6)
        seen = world.layout.as_dict(returns.obs[0])
        off = abs(seen["speed_along"] - TASK.pace)
        terms.append(abs(seen["normal_error"]) + FEW.pace_weight * off)
    assert costs[0] == pytest.approx(np.mean(terms), rel=1e-5)


def test_a_plan_that_leaves_the_workspace_costs_the_workspace() -> None:
    narrow = replace(TASK, error_max=0.002)
    settings = Settings(samples=4, rounds=1, elite=1)
    planner = Planner(settings, MACHINE, narrow, Free())
    world = Batch(MACHINE, narrow, 1)
    obs, _ = world.reset([1])
    costs = planner.costs(state_of(world), obs[0], np.zeros((4, settings.knots, 4)))
    assert world.rollout(obs, *_law(Free(), world), settings.horizon)[1][:2, 0, COLUMN.terminated].max() == 1.0
    assert (costs > narrow.error_max).all()


def _law(controller: Free, world: Batch) -> tuple[object, np.ndarray]:
    policy = controller.bind(BASELINE, world.layout)
    return policy.law, policy.gains


def test_outcome_is_the_end_of_a_rollout() -> None:
    batch = Batch(MACHINE, TASK, 2)
    obs, _ = batch.reset([1, 2])
    gains = np.concatenate([[5.0, 13.0, 0.005], np.linspace(0.0, 3.0, 2 * 13 * 4)])
    assert len(gains) == PLANS + 2 * 13 * 4
    before = batch.get_state()
    last, rows = batch.rollout(obs, play, gains, 60)
    after = batch.get_state()
    batch.set_state(before)
    seen, flags = batch.outcome(obs, play, gains, 60, batch.empty_memory())
    np.testing.assert_array_equal(seen, last)
    np.testing.assert_array_equal(batch.get_state()["worlds"], after["worlds"])
    np.testing.assert_array_equal(flags[FLAG.terminated], (rows[..., COLUMN.terminated] == 1.0).any(axis=0))
    np.testing.assert_array_equal(flags[FLAG.success], (rows[..., COLUMN.is_success] == 1.0).any(axis=0))
    assert flags[FLAG.terminated].any()


def test_the_cost_reads_the_speed_along() -> None:
    assert observation_layout(BASELINE, "encoders").index("speed_along") == SEEN.speed.along


# --- what the honest one knows ---


@pytest.mark.slow
def test_the_honest_one_cannot_know_the_future_and_the_privileged_one_does() -> None:
    change, steps = 8, 12
    calm = [5.0] * 80
    tasks = [pushed(calm), pushed(calm[: change + 1] + [-40.0] * 71)]
    for kind, knows in ((Honest, False), (Privileged, True)):
        one, other = (record_episode(kind(GUIDE, FEW), MACHINE, task, 0, steps) for task in tasks)
        equal = [np.array_equal(a, b) for a, b in zip(one.volts, other.volts, strict=True)]
        if knows:
            assert not all(equal[: change + 1])
        else:
            np.testing.assert_array_equal(one.obs[: change + 1], other.obs[: change + 1])
            assert all(equal[: change + 1])
        assert not all(equal)


def test_the_honest_one_reads_nothing_but_path_and_pace() -> None:
    other = replace(
        TASK,
        hand=replace(TASK.hand, push=1.0, amplitudes=(9.0,) * 5),
        friction_drift=0.01,
        sensing=Sensing(delay=2, torque_noise=1.0),
        start_offset=0.01,
    )
    assert known_part(other, 30) == known_part(TASK, 30)
    assert (known_part(TASK, 30).path, known_part(TASK, 30).pace) == (TASK.path, TASK.pace)


OTHER = replace(
    BASELINE,
    arm=replace(BASELINE.arm, inertia_a=0.7),
    clutch=replace(DELRIN_EXPERIMENTAL.clutch, time_constant=0.06),
    clutch_scale=(0.8, 1.2, 1.1, 0.9),
)


@pytest.mark.parametrize("nominal", [BASELINE, OTHER], ids=["paper", "own"])
def test_the_rebuilt_state_is_the_true_one_on_the_nominal_machine(nominal: Machine) -> None:
    ((machine, task),) = find_scenario("paths", nominal).randomisation("brisk", contexts=1, seed=2).pairs()
    world = Batch(machine, task, 1, sensors="force")
    belief = Belief(known_part(task, 30), nominal, world.layout)
    rng = np.random.default_rng(3)
    obs, _ = world.reset([4])
    for _ in range(20):
        belief.update(obs[0])
        true = state_of(world)
        rows = slice(0, ROW.lagged_volts.x1)  # motion and the clutches' torques
        np.testing.assert_allclose(belief.rows[rows], true[rows], atol=2e-4)
        arc = slice(ROW.foot.arc_length, ROW.reached + 1)  # where it is on the path
        np.testing.assert_allclose(belief.rows[arc], true[arc], atol=1e-5)
        obs = world.step(rng.uniform(4.0, 14.0, (1, 4))).obs


def test_the_hand_model_keeps_the_push_and_forgets_the_disturbance() -> None:
    hand = ForceForecast(0.01, 31)
    forces = hand.forecast(60.0, 10.0)
    assert forces.shape == (31, 2)
    np.testing.assert_allclose(forces[:, 0], 60.0)
    np.testing.assert_allclose(forces[[0, 5], 1], [10.0, 10.0 * np.exp(-1.0)])
    assert 60.0 < hand.forecast(70.0, 0.0)[0, 0] < 70.0


def test_recorded_forces_are_what_the_hand_then_does() -> None:
    task = pushed([0.0] * 4)
    batch = Batch(MACHINE, task, 2, sensors="force")
    forces = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]])
    batch.record_forces(forces)
    obs, _ = batch.reset([0, 1])
    assert batch.get_state()["worlds"][0, ROW.drive.force.along, 0] == 1.0
    for k in range(3):
        for name, column in (("force_along", 0), ("force_across", 1)):
            np.testing.assert_allclose(batch.layout.physical(obs, name), forces[k, column], rtol=1e-6)
        obs = batch.step(np.zeros((2, 4))).obs
    with pytest.raises(ParameterError, match=r"forces must be .* \(4, 2\), got \(3, 2\)"):
        batch.record_forces(forces[:3])
    with pytest.raises(ParameterError, match="forces must be"):
        Batch(MACHINE, TASK, 1).record_forces(forces)


@pytest.mark.parametrize(
    ("field", "keywords"),
    [
        ("samples", {"samples": 1}),
        ("samples", {"samples": 64.5}),
        ("elite", {"elite": 0}),
        ("elite", {"samples": 8, "elite": 9}),
        ("horizon", {"horizon": 12}),
        ("knot_steps", {"knot_steps": 0}),
        ("rounds", {"rounds": 0}),
        ("spread", {"spread": 0.0}),
        ("spread_min", {"spread_min": -1.0}),
        ("pace_weight", {"pace_weight": -1.0}),
        ("seed", {"seed": -1}),
    ],
)
def test_bad_settings_are_named(field: str, keywords: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match=rf"Settings\.{field} must be"):
        Settings(**keywords)  # type: ignore[arg-type]


def test_any_controller_may_guide() -> None:
    policy = Privileged(Free(), Settings(samples=8, rounds=1, elite=1))
    assert len(record_episode(policy, MACHINE, TASK, 0, 3).telemetry) == 4
