"""Scenarios: what they draw, on whose machine, and how their episodes begin."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from pter_gym import load_policy
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW, SAME_STEP
from pter_gym.benchmark import assess, evaluate, find_policy, run_scenario, training_episodes
from pter_gym.benchmark.episodes import find_episodes, load_episodes, scenarios
from pter_gym.controllers import TorqueFeedback, bind
from pter_gym.envs import PathFollowingEnv
from pter_gym.errors import ParameterError, ResetNeededError
from pter_gym.hands import NORMAL, HumanArm
from pter_gym.params import (
    BASELINE,
    DELRIN_EXPERIMENTAL,
    MACHINES,
    Hand,
    Machine,
    MachineSpread,
    find_machine,
    save_machine,
)
from pter_gym.paths import Arc, Circle, Line, Sine, find_path
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario
from pter_gym.scenarios.distributions import Draws, LogUniform, OneOf, Shared, Uniform, Vary, drawn
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks.path_following import (
    AT_REST,
    COLUMN,
    STARTS,
    PathFollowing,
    RewardWeights,
    Sensing,
    Starts,
    check_machine,
    observation_layout,
)
from pter_gym.tasks.path_following._context import OBSERVED_CONTEXT
from pter_gym.tasks.path_following._observation import BOUND
from pter_gym.tasks.path_following._specification import sensing_of

MOVING, GRIPPED = Starts(moving=1.0), Starts(gripped=1.0)
COUNT = 512
PROGRESS = observation_layout(BASELINE, "torque").names.index("progress")
NEAR = PathFollowing(truncation_error=0.1)
"""A task whose disturbance takes a free arm away from the path."""

OWN = replace(
    BASELINE,
    arm=replace(BASELINE.arm, inertia_a=0.7),
    clutch_scale=(0.9, 1.1, 1.05, 0.95),
    delay=0.012,
)

# --- what is drawn ---


def test_draws_depend_on_the_seed_alone_and_reach_every_pair() -> None:
    pairs = SCENARIOS["everything"].draws.pairs(40)
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
    pairs = SCENARIOS["materials"].draws.pairs(10)
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks, observe_context=True)
    obs, rows = batch.reset([0] * 10)
    told = rows[:, -len(OBSERVED_CONTEXT) :]
    np.testing.assert_array_equal(
        told[:, 0], [machine.clutch.time_constant for machine in machines]
    )
    top = BASELINE.clutch.voltage_max
    for machine, row in zip(machines, told, strict=True):
        expected = (
            np.mean(machine.clutch_scale)
            * machine.clutch.dynamic.torque(top)
            / BASELINE.clutch.dynamic.torque(top)
        )
        assert row[2] == pytest.approx(expected, rel=1e-12)
    scaled = np.clip(told / OBSERVED_CONTEXT.scales, -BOUND, BOUND)
    np.testing.assert_allclose(obs[:, -len(OBSERVED_CONTEXT) :], scaled, rtol=1e-6)
    assert batch.layout.names[-len(OBSERVED_CONTEXT) :] == OBSERVED_CONTEXT.names


def test_the_same_seed_gives_the_same_pairs() -> None:
    draws = SCENARIOS["everything"].draws
    one, two, other = (draws.pairs(12, seed) for seed in (3, 3, 4))
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
    assert drawn((Uniform(1.0, 1.0), OneOf(("x",)), 2), rng) == (1.0, "x", 2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Uniform(1.0, 0.0), r"Uniform\.high"),
        (lambda: LogUniform(0.0, 1.0), r"LogUniform\.low"),
        (lambda: OneOf(()), r"OneOf\.options"),
        (lambda: Vary(BASELINE.arm, inertia_a=Uniform(-0.1, 1.0)), r"Arm\.inertia_a"),
        (lambda: Vary(BASELINE.arm, inertia=Uniform(0.1, 1.0)), r"Arm .*inertia"),
        (lambda: Vary(BASELINE.clutch, time_constant=Uniform(0.0, 1.0)), r"Clutch\.time_constant"),
        (lambda: Vary(BASELINE, clutch_scale=(Uniform(-1.0, 1.0),) * 4), r"Machine\.clutch_scale"),
        (
            lambda: Vary(
                HumanArm(),
                impedance=Vary(Hand(mass=1.0, stiffness=1.0), stiffness=Uniform(0.0, 9.0)),
            ),
            r"impedance\.stiffness",
        ),
        (lambda: Vary(PathFollowing(), pace=Uniform(0.1, 9.0)), r"PathFollowing\.pace"),
        (lambda: Draws(task=PathFollowing()).pairs(0), "n must be a whole number"),
        (lambda: Draws(task=PathFollowing()).pairs(1, -1), "seed"),
        (lambda: Draws(task=PathFollowing(), also=(1,)), r"Draws\.also"),  # type: ignore[arg-type]
        (lambda: Draws(task=PathFollowing(), also=Draws(task=PathFollowing())), r"Draws\.also"),  # type: ignore[arg-type]
        (lambda: Draws(task=PathFollowing(), instead=1), r"Draws\.instead"),  # type: ignore[arg-type]
        (lambda: Draws(task=Vary(Line())).pairs(1), r"Draws\.task"),  # type: ignore[arg-type]
        (lambda: Draws(task=PathFollowing()).pairs(1, 0, "fast"), "pace"),
    ],
)
def test_impossible_distributions_are_refused_when_built(make: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()


def test_draws_whose_paths_all_leave_the_reach_are_refused() -> None:
    far = Vary(PathFollowing(), path=Vary(Arc(), y=Uniform(3.0, 4.0)))
    with pytest.raises(ParameterError, match="path"):
        Draws(task=far).pairs(1)


def test_mixed_draws_have_the_pairs_of_their_parts_by_weight() -> None:
    line, circle = (Draws(task=PathFollowing(error_max=0.1, path=p)) for p in (Line(), Circle()))
    mixed = replace(line, also=(replace(circle, weight=2), SCENARIOS["hands"].draws))
    kinds = [type(task.path) for _, task in mixed.pairs(8, 1, "slow")]
    assert kinds == [Line] * 2 + [Circle] * 4 + [Line] * 2
    assert mixed.pairs(8, 1, "slow")[6:] == SCENARIOS["hands"].draws.pairs(2, 1, "slow")
    rng = np.random.default_rng(0)
    share = np.mean([isinstance(mixed.draw(rng)[1].path, Circle) for _ in range(400)])
    assert abs(share - 0.5) < 4.0 * 0.5 / np.sqrt(400)


def test_unknown_names_suggest_the_nearest() -> None:
    for wrong, near in (
        (lambda: find_scenario("material"), "'materials'"),
        (lambda: find_pace("mediums"), "'medium'"),
        (lambda: find_path("cirle"), "'circle'"),
        (lambda: find_machine("delrin"), "'delrin_experimental' or 'delrin_theoretical'"),
        (lambda: gymnasium.make("PTER/PathFollowing-v0", scenario="standart"), "'standard'"),
    ):
        with pytest.raises(ParameterError, match=near):
            wrong()


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_environments_take_names_and_objects(make: Any, tmp_path: Path) -> None:
    (tmp_path / "track.csv").write_text("x,y\n-0.4,0.6\n0.0,0.65\n0.4,0.6\n", "utf-8")
    for path in ("circle", Circle(), str(tmp_path / "track.csv")):
        _, task = make("PTER/PathFollowing-v0", path=path, pace="medium").unwrapped.batch.pairs[0]
        assert (task.path, task.pace) == (find_path(path), PACES["medium"])
    for name, keywords in (
        ("PathFollowing", {}),
        ("PathFollowing", {"scenario": "paths", "contexts": 3}),
        ("PathFollowing", {"scenario": Draws(task=PathFollowing()), "contexts": 3}),
        ("Standard", {"contexts": 3}),
    ):
        env = make(
            f"PTER/{name}-v0", path="sine", pace=0.3, machine="two-brakes", **keywords
        ).unwrapped
        for machine, task in env.batch.pairs:
            assert (machine, task.path, task.pace) == (MACHINES["two-brakes"], Sine(), 0.3)


@pytest.mark.parametrize(
    ("keywords", "field"),
    [
        ({"path": "circel"}, "path"),
        ({"path": 3}, "path"),
        ({"pace": "fast"}, "pace"),
        ({"pace": -1.0}, "pace"),
        ({"path": "circle", "task": PathFollowing()}, "path"),
        ({"scenario": 1}, "scenario"),
        ({"scenario": "standard", "task": PathFollowing()}, "scenario"),
        ({"scenario": "hands", "reward": 1}, "reward"),
        ({"context_seed": 1}, "context_seed"),
    ],
)
def test_invalid_names_are_refused(keywords: dict[str, Any], field: str) -> None:
    with pytest.raises(ParameterError, match=field):
        gymnasium.make("PTER/PathFollowing-v0", **keywords)


@pytest.mark.parametrize(
    ("keywords", "name"),
    [
        ({}, "standard"),
        ({"path": "circle"}, "paths"),
        ({"task": PathFollowing(path=Circle(), error_max=0.1)}, "paths"),
        ({"task": PathFollowing(hand=HumanArm())}, "hands"),
        ({"task": PathFollowing(hand=HumanArm(), path=Circle(), error_max=0.1)}, "everything"),
        ({"scenario": "everything"}, "everything"),
        ({"scenario": SCENARIOS["wall"]}, "wall"),
        ({"scenario": SCENARIOS["paths"].draws}, "paths"),
        ({"scenario": "standard", "path": "circle"}, "paths"),
        ({"scenario": "hands", "path": "circle"}, "hands"),
    ],
)
def test_environments_know_whose_gains_their_episodes_need(
    keywords: dict[str, Any], name: str
) -> None:
    keywords |= {"contexts": 3} if "scenario" in keywords else {}
    assert gymnasium.make("PTER/PathFollowing-v0", **keywords).unwrapped.whose_gains == name  # pyright: ignore[reportAttributeAccessIssue]
    pytest.importorskip("stable_baselines3")
    from pter_gym.envs.sb3 import make_sb3_vec_env

    assert make_sb3_vec_env(2, **keywords).get_attr("whose_gains") == [name] * 2


# --- one's own machine ---

BIG = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.8, length_b=0.7))
FAR = Line(x=-0.4, y=1.15, length=0.8)
"""Beyond the reach of PTER, within that of BIG."""

TWO = MACHINES["two-brakes"]

STIFF_TWO = replace(TWO, arm=replace(TWO.arm, inertia_a=0.5))

BIGGER = replace(BIG, arm=replace(BIG.arm, inertia_a=2.0))

SCALES = Vary(BIG, clutch_scale=(Uniform(0.9, 1.1),) * 4)


@dataclass(frozen=True)
class Unknown:
    """A distribution of a user's."""

    def draw(self, rng: np.random.Generator) -> Machine:
        return (BIG, BIGGER)[int(rng.integers(2))]

    def extremes(self) -> tuple[Machine, ...]:
        return BIG, BIGGER


@dataclass(frozen=True)
class Own(Unknown):
    """One that says which machine laws know."""

    middle: Machine


@pytest.mark.parametrize(
    ("draws", "expected"),
    [
        (Draws(task=PathFollowing(), machine=BIG), BIG),
        (Draws(task=PathFollowing(), machine=SCALES), BIG),
        (Draws(task=PathFollowing(), machine=SCALES, instead=OWN), OWN),
        (
            Draws(
                task=PathFollowing(),
                machine=MachineSpread(machine=BIG, places=("delay",), covariance=((1e-9,),)),
            ),
            BIG,
        ),
        (
            Draws(
                task=PathFollowing(),
                machine=Vary(BASELINE, arm=Vary(BIG.arm, inertia_a=Uniform(0.5, 0.9))),
            ),
            BIG,
        ),
        (Draws(task=PathFollowing(), machine=Vary(BASELINE, arm=BIG.arm)), BIG),
        (Draws(task=PathFollowing(), machine=SCALES, also=(SCENARIOS["paths"].draws,)), BIG),
        (Draws(task=PathFollowing(path=FAR), instead=OneOf((BIG, BIGGER))), BIG),
        (Draws(task=PathFollowing(), machine=OneOf((OneOf((SCALES, BIGGER)), OWN))), BIG),  # pyright: ignore[reportArgumentType]
        (Draws(task=PathFollowing(), instead=Own(BIG)), BIG),
        (Draws(task=PathFollowing(), instead=OneOf((TWO, STIFF_TWO))), TWO),
    ],
)
def test_one_machine_is_known_at_every_door(draws: Draws, expected: Machine) -> None:
    """It is the middle of the draws, of mixed ones that of the first part."""
    known = [
        PathFollowingEnv(scenario=draws, contexts=count).nominal_machine for count in (1, 2, 3)
    ]
    scenario = find_scenario(draws)
    known += [find_episodes(scenario, "slow", seed).nominal for seed in (None, 0)]
    known += [training_episodes(scenario, "slow", 2, 0).nominal, scenario.nominal]
    assert known == [expected] * 7


def test_draws_that_do_not_say_which_machine_laws_know_are_asked() -> None:
    with pytest.raises(ParameterError, match=r"Draws\.instead .* attribute middle"):
        find_scenario(Draws(task=PathFollowing(), instead=Unknown())).nominal  # noqa: B018


def test_a_path_within_the_reach_of_drawn_machines_is_accepted() -> None:
    own = find_scenario(Draws(task=PathFollowing(), instead=OneOf((BIG, BIGGER))), path=FAR)
    assert own.nominal == BIG


def test_a_law_knows_the_first_of_several_machines() -> None:
    """Bound to PTER it lets the tip go nearly twice as far."""
    draws = Draws(task=PathFollowing(path=FAR), instead=OneOf((BIG, BIGGER)))
    (run,) = run_scenario(draws, "impedance", "medium", episodes=8)
    alone = replace(find_episodes(find_scenario(draws), "medium", 0).first(8), nominal=BIG)
    bound = evaluate(find_policy("impedance", "paths"), alone)
    np.testing.assert_array_equal(run.scores["path_error_m"], bound["path_error_m"])


@pytest.mark.long
def test_a_law_that_knows_two_brakes_runs_on_draws_about_them() -> None:
    machine = Vary(MACHINES["two-brakes"], clutch_scale=(Uniform(0.9, 1.1),) * 4)
    (run,) = run_scenario(
        Draws(machine=machine, task=PathFollowing()), "impedance", "brisk", episodes=2
    )
    assert np.isfinite(run.scores["path_error_m"]).all()


@pytest.mark.parametrize(
    "scenario",
    ["standard", "everything", Draws(task=PathFollowing(path=FAR)), PathFollowing(path=FAR)],
    ids=["standard", "everything", "draws", "a task"],
)
def test_a_path_is_checked_on_the_users_arm(scenario: Any) -> None:
    found = find_scenario(scenario, BIG, FAR)
    assert {(machine, task.path) for machine, task in found.draws.pairs(3)} == {(BIG, FAR)}
    with pytest.raises(ParameterError, match="path"):
        find_scenario(scenario, None, FAR)
    if isinstance(scenario, str):
        gymnasium.make(find_scenario(scenario).id, machine=BIG, path=FAR, contexts=2)
    else:
        own = Draws(machine=SCALES, task=PathFollowing())
        assert find_scenario(own, path=FAR).nominal == BIG


@pytest.fixture
def own(tmp_path: Path) -> str:
    save_machine(OWN, tmp_path / "own.toml", origin="chosen: for tests")
    return str(tmp_path / "own.toml")


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_fixed_machine_leaves_other_draws_unchanged(name: str, own: str) -> None:
    machines, tasks = zip(*find_scenario(name, own).draws.pairs(40, 3, "slow"), strict=True)
    assert set(machines) == {OWN}
    assert list(tasks) == [task for _, task in find_scenario(name).draws.pairs(40, 3, "slow")]


def test_a_machines_delay_replaces_that_of_a_tasks_sensors() -> None:
    few = PathFollowing(sensing=Sensing(velocity_noise=0.1, delay=1))
    assert sensing_of(few, BASELINE) is few.sensing
    for seconds, steps in ((0.002, 0), (0.012, 1), (0.02, 2)):
        delayed = sensing_of(few, replace(BASELINE, delay=seconds))
        assert delayed == Sensing(velocity_noise=0.1, delay=steps)
    seen = [
        Batch(machine, PathFollowing(sensing=Sensing(delay=steps)))
        for machine, steps in ((BASELINE, 1), (replace(BASELINE, delay=0.01), 0), (BASELINE, 0))
    ]
    first = [batch.reset([0])[0] for batch in seen]
    rows = [
        [obs, *(batch.step(np.full((1, 4), 5.0)).obs for _ in range(5))]
        for obs, batch in zip(first, seen, strict=True)
    ]
    late, own, exact = np.array(rows)
    assert (late == own).all()
    assert (late != exact).any()


def test_a_machine_that_a_task_cannot_have_is_refused() -> None:
    slow = replace(BASELINE, delay=0.03)
    for wrong, field in (
        (lambda: find_scenario("standard", "delrin_experimentel"), "machine"),
        (lambda: replace(BASELINE, delay=-0.01), r"Machine\.delay"),
        (lambda: find_scenario("paths", slow), r"Machine\.delay must be at most 0\.02 s"),
        (lambda: gymnasium.make("PTER/PathFollowing-v0", machine=slow), r"Machine\.delay"),
        (lambda: gymnasium.make("PTER/Standard-v0", machine=3), "machine"),
    ):
        with pytest.raises(ParameterError, match=field):
            wrong()


def test_environments_and_laws_take_a_user_machine(own: str) -> None:
    for path in (own, Path(own)):
        env: Any = gymnasium.make("PTER/Everything-v0", machine=path, contexts=5)
        assert {machine for machine, _ in env.unwrapped.batch.pairs} == {OWN}
        assert env.unwrapped.nominal_machine == OWN
        env.spec.to_json()
    about = MachineSpread(machine=OWN, places=("arm.inertia_a",), covariance=((1e-4,),))
    drawn = PathFollowingEnv(scenario=find_scenario("everything", about), contexts=5)
    assert (drawn.nominal_machine, len({machine for machine, _ in drawn.batch.pairs})) == (OWN, 5)
    assert (find_scenario("standard", own).nominal, find_scenario("standard").nominal) == (
        OWN,
        BASELINE,
    )
    mixed = Draws(task=PathFollowing(), also=(Draws(task=NEAR, machine=MACHINES["two-brakes"]),))
    assert {machine for machine, _ in find_scenario(mixed, own).draws.pairs(4)} == {OWN}
    draws, law = training_episodes("standard", "slow", 4, 5, own), TorqueFeedback(feedback=0.5)
    layout, others = (
        observation_layout(OWN, "torque"),
        replace(OWN, clutch=DELRIN_EXPERIMENTAL.clutch),
    )
    assert assess([law], draws) == assess([bind(law, OWN, layout)], draws)
    assert assess([law], draws) != assess([bind(law, others, layout)], draws)


# --- how episodes begin, and end near the path ---


def first_rows(
    scenario: str, starts: Starts, seed: int = 0
) -> tuple[np.ndarray, list[PathFollowing]]:
    """Return the telemetry of resets, and the tasks that were begun."""
    pairs = SCENARIOS[scenario].draws.with_task(starts=starts).pairs(64)
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks, COUNT, draws=True)
    rows = batch.reset(range(seed, seed + COUNT))[1]
    return rows, [tasks[k] for k in rows[:, COLUMN.context].astype(int)]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_moving_starts_are_all_along_the_path_and_within_the_workspace(scenario: str) -> None:
    rows, tasks = first_rows(scenario, MOVING)
    share = rows[:, COLUMN.arc_length] / [task.path.length for task in tasks]
    assert share.min() < 0.02
    assert 0.9 < share.max() < 0.93
    np.testing.assert_allclose(
        rows[:, COLUMN.reached], rows[:, COLUMN.arc_length], rtol=1e-12, atol=1e-12
    )
    errors = np.abs(rows[:, COLUMN.normal_error])
    furthest = MOVING.offset - min(tasks[0].free_left, tasks[0].free_right)
    assert (errors <= furthest + 1e-12).all()
    assert errors.max() > 0.9 * furthest
    speed = np.hypot(*rows[:, [*COLUMN.tip_velocity]].T) / [task.pace for task in tasks]
    assert speed.max() < 2.07, "twice the pace along the path and half of it across"
    assert 0.9 < speed.mean() < 1.2
    assert np.isfinite(rows).all()


def test_gripped_starts_are_at_rest_with_settled_clutches() -> None:
    rows, _ = first_rows("standard", GRIPPED)
    at_rest, _ = first_rows("standard", AT_REST)
    np.testing.assert_array_equal(rows[:, [*COLUMN.tip]], at_rest[:, [*COLUMN.tip]])
    assert not rows[:, [*COLUMN.tip_velocity]].any()
    volts = rows[:, [*COLUMN.volts]]
    released = (volts == 0.0).mean()
    assert abs(released - 0.2) < 4.0 * np.sqrt(0.2 * 0.8 / volts.size)
    engaged = volts[volts > 0.0]
    assert abs(engaged.mean() - 12.0) < 4.0 * 24.0 / np.sqrt(12.0 * engaged.size)
    assert not at_rest[:, [*COLUMN.volts]].any()


def test_settled_clutches_hold_what_they_would_after_a_long_time() -> None:
    task = PathFollowing(starts=GRIPPED)
    batch = Batch(BASELINE, task, 16)
    volts = batch.reset(range(16))[1][:, [*COLUMN.volts]]
    assert volts.any(axis=1).all()
    gripped = batch.truth()
    still = Batch(
        replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=1e-6)), PathFollowing(), 16
    )
    still.reset(range(16))
    still.step(volts)
    first, last = ROW.torques.breakaway.x1, ROW.torques.dynamic.x4 + 1
    np.testing.assert_allclose(gripped[:, first:last], still.truth()[:, first:last], rtol=1e-12)


def test_a_moving_start_is_within_a_narrow_workspace_with_the_intent_at_the_tip() -> None:
    path = Line(x=-0.1, y=0.5, direction=0.0, length=0.2)
    task = PathFollowing(path=path, hand=HumanArm(), error_max=0.03, starts=MOVING)
    batch = Batch(BASELINE, task, 16)
    row = batch.reset(range(16))[1]
    assert 0.0 < np.abs(row[:, COLUMN.normal_error]).max() <= 0.03 < MOVING.offset
    ahead = batch.truth()[:, ROW.intent] - row[:, COLUMN.arc_length]
    assert (ahead >= -1e-12).all()
    assert (ahead <= task.pace * task.control_period).all()
    assert row[:, COLUMN.arc_length].max() > 0.1


def test_shares_are_kept_and_each_seed_begins_the_same_way() -> None:
    starts = STARTS["path"]
    rows, _ = first_rows("standard", starts)
    again, _ = first_rows("standard", starts)
    np.testing.assert_array_equal(rows, again)
    moving = (rows[:, COLUMN.arc_length] > 0.0).mean()
    gripped = ((rows[:, COLUMN.arc_length] <= 1e-9) & rows[:, [*COLUMN.volts]].any(axis=1)).mean()
    for found, share in ((moving, starts.moving), (gripped, starts.gripped)):
        assert abs(found - share) < 4.0 * np.sqrt(share * (1.0 - share) / COUNT)


@pytest.mark.parametrize("scenario", scenarios())
def test_training_and_evaluation_have_the_same_workspaces(scenario: str) -> None:
    evaluated = load_episodes(scenario, "slow").tasks
    assert {task.starts for task in evaluated} == {AT_REST}
    widths = {task.error_max for task in evaluated}
    env: Any = gymnasium.make(find_scenario(scenario).id, contexts=4).unwrapped
    for task in (*evaluated, *(task for _, task in env.batch.pairs)):
        assert task.error_max in widths
        assert task.truncation_error > task.error_max


def test_an_episode_that_strays_is_truncated_and_is_no_failure() -> None:
    free = np.zeros(4)
    for reward in (RewardWeights(), RewardWeights(failure=0.0)):
        near: Any = gymnasium.make(
            "PTER/PathFollowing-v0", task=replace(NEAR, reward=reward), action_unit="volt"
        ).unwrapped
        wide: Any = gymnasium.make(
            "PTER/PathFollowing-v0", task=PathFollowing(reward=reward), action_unit="volt"
        ).unwrapped
        near.reset(seed=0), wide.reset(seed=0)
        truncated = terminated = False
        while not (truncated or terminated):
            observation, pay, terminated, truncated, info = near.step(free)
            same, as_much, ends, _, told = wide.step(free)
            assert (observation == same).all()
            assert pay == as_much
            assert abs(told["telemetry"][COLUMN.normal_error]) <= 0.1 or truncated
        assert (terminated, truncated, ends, info["is_success"]) == (False, True, False, False)
        with pytest.raises(ResetNeededError):
            near.step(free)


@pytest.mark.parametrize(
    ("error_max", "terminated"), [(0.099, True), (0.1 - 1e-9, True), (0.1, False), (0.101, False)]
)
def test_the_nearer_limit_ends_an_episode_and_truncation_wins_ties(
    error_max: float, terminated: bool
) -> None:
    """A step that goes beyond both is terminated alone."""
    env: Any = gymnasium.make(
        "PTER/PathFollowing-v0", task=replace(NEAR, error_max=error_max), action_unit="volt"
    ).unwrapped
    env.reset(seed=0)
    ends = (False, False)
    while not any(ends):
        _, _, *ends, _ = env.step(np.zeros(4))
    assert tuple(ends) == (terminated, not terminated)


def test_a_training_episode_that_strays_is_never_terminated_on_the_way() -> None:
    worlds: Any = gymnasium.make_vec("PTER/Paths-v0", 64, starts="rest", truncation_error=0.1)
    worlds.reset(seed=0)
    truncations = 0
    for _ in range(200):
        observations, _, terminated, truncated, infos = worlds.step(np.zeros((64, 4)))
        strayed = np.abs(infos["telemetry"][:, COLUMN.normal_error]) > 0.1
        assert not (terminated & strayed & (observations[:, PROGRESS] < 0.5)).any()
        truncations += (truncated & strayed).sum()
    assert truncations > 64


def test_a_scenario_takes_what_its_episodes_share_and_nothing_that_it_draws() -> None:
    env: Any = gymnasium.make(
        "PTER/Standard-v0", error_max=0.08, starts=MOVING, pace="slow"
    ).unwrapped
    env.reset(seed=0)
    assert (env.task.error_max, env.task.starts, env.task.pace) == (0.08, MOVING, 0.12)
    with pytest.raises(ParameterError, match="path"):
        SCENARIOS["paths"].draws.with_task(path=None)


def test_drawn_machines_can_begin_in_motion_where_they_may_be() -> None:
    """Paths are drawn further from singular poses than episodes may go, where motion is faster."""
    impedance = Vary(
        NORMAL, mass=Uniform(0.5, 2.5), damping=Uniform(4, 40), stiffness=Uniform(80, 800)
    )
    arm = Vary(BASELINE.arm, inertia_a=Uniform(0.36, 0.75))
    moving = PathFollowing(starts=STARTS["path"], pace=0.5)
    hand = Vary(HumanArm(), impedance=impedance)
    draws = Draws(machine=Vary(BASELINE, arm=arm), task=Vary(moving, hand=hand))
    for machine, task in draws.pairs(300):
        check_machine(task, machine)


def returns_of(policy: str, scenario: str, worlds: int = 256) -> np.ndarray:
    """Return what a policy earns in the first training episode of each world."""
    envs: Any = gymnasium.make_vec(
        find_scenario(scenario).id, worlds, frame_skip=1, max_episode_steps=3000, telemetry=False
    )
    acting = load_policy(policy, envs)
    observations, _ = envs.reset(seed=1)
    total, running = np.zeros(worlds), np.ones(worlds, bool)
    while running.any():
        observations, rewards, terminated, truncated, _ = envs.step(acting(observations))
        total += running * rewards
        running &= ~(terminated | truncated)
    return total


@pytest.mark.parametrize(
    "scenario",
    [pytest.param(x, marks=pytest.mark.long if x != "standard" else ()) for x in SCENARIOS],
)
def test_a_trained_policy_solves_an_id_and_a_tuned_law_does_not(scenario: str) -> None:
    threshold: Any = gymnasium.spec(find_scenario(scenario).id).reward_threshold
    earned = returns_of("residual", scenario)
    error = 2.0 * earned.std() / np.sqrt(len(earned))  # of this mean and of the stored one
    assert abs(0.9 * earned.mean() - threshold) < 3.0 * error
    assert returns_of("single-dof-tuned", scenario).mean() + error < threshold
