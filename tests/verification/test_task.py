"""The functions of the task and the hand, each against a formula written otherwise; borders of what
is accepted."""

import cmath
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pter_gym._compiled.records import load, store
from pter_gym._engine.batch import Batch
from pter_gym._engine.episode import place, spread
from pter_gym._engine.hand import hand_force, intended
from pter_gym._engine.sensors import gaussians, take_reading
from pter_gym._engine.world import ROW, ROWS, Target
from pter_gym._physics.arm import (
    Linkage,
    Motion,
    PerLink,
    UnitVector,
    Vector,
    motion_at,
    tip_position,
    tip_velocity,
)
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.model import model_of
from pter_gym._physics.stability import MAX_SUBSTEPS, largest_energy, largest_travel
from pter_gym.errors import ParameterError
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces
from pter_gym.hands._model import (
    NO_FORCE,
    PerSine,
    Sines,
    advance_sines,
    intent_speed,
    renew_sines,
    sum_of_sines,
)
from pter_gym.params import BASELINE, Clutch, Hand, TorqueCurve
from pter_gym.paths import Arc, Line, Polyline
from pter_gym.paths._projection import Foot
from pter_gym.tasks.path_following import (
    COLUMN,
    TELEMETRY,
    PathFollowing,
    Reason,
    RewardWeights,
    Sensing,
    Starts,
    check_machine,
    observation_layout,
    reason_of,
)
from pter_gym.tasks.path_following._context import context_of
from pter_gym.tasks.path_following._ending import reached_end, singular, strayed, too_fast
from pter_gym.tasks.path_following._model import PathModel, SensingModel
from pter_gym.tasks.path_following._observation import (
    Measurement,
    Reading,
    measurement_of,
    observation,
)
from pter_gym.tasks.path_following._pace import ALLOWANCE, in_start_up, start_up_allowance
from pter_gym.tasks.path_following._position import (
    FreeBand,
    PathState,
    PathVector,
    to_path,
    to_world,
)
from pter_gym.tasks.path_following._reward import (
    Outcome,
    Terms,
    pace_cost,
    pace_share,
    reward_terms,
    total,
)
from pter_gym.tasks.path_following._specification import (
    held_machine,
    sin_elbow,
    strongest,
    substeps,
)

DRAWS = range(10)


def vector(seed: int) -> complex:
    return complex(*np.random.default_rng([5, seed]).normal(size=2))


def unit(angle: float) -> UnitVector:
    return UnitVector(math.cos(angle), math.sin(angle))


# --- where the tip is ---


@pytest.mark.parametrize("seed", DRAWS)
def test_parts_along_and_across_a_path_by_complex_numbers(seed: int):
    v, angle = vector(seed), float(seed)
    turned = v * np.exp(-1j * angle)
    assert to_path(Vector(v.real, v.imag), unit(angle)) == pytest.approx((turned.real, turned.imag))
    assert to_world(PathVector(turned.real, turned.imag), unit(angle)) == pytest.approx(
        (v.real, v.imag)
    )


@pytest.mark.parametrize("tip", [(0.3, 0.6), (-0.5, 0.2), (0.1, -0.9), (0.4, 0.05)])
def test_the_arm_at_a_tip_has_its_tip_there_and_link_b_ahead(tip: tuple[float, float]):
    arm = Linkage(
        length_a=0.4,
        length_b=0.7,
        m11=0.3,
        m22=0.5,
        coupling=0.2,
        damping=0.0,
        stiffness=0.0,
        implicit=0.5,
    )
    q = motion_at(arm, *tip)
    assert tip_position(arm, q) == pytest.approx(tip, abs=1e-12)
    assert (q.cos_a, q.sin_a, q.cos_b, q.sin_b) == pytest.approx(
        (*unit(q.theta_a), *unit(q.theta_b))
    )
    assert math.sin(q.theta_b - q.theta_a) > 0.0
    assert (q.omega_a, q.omega_b) == (0.0, 0.0)


def test_where_an_episode_ends():
    assert [reached_end(s, 1.0) for s in (0.999, 1.0, 1.5)] == [False, True, True]
    assert [strayed(0.5, e, 0.2) for e in (-0.21, -0.2, 0.2, 0.21)] == [True, False, False, True]
    assert [strayed(s, 0.0, 0.2) for s in (-0.21, -0.2, 0.0)] == [True, False, False]
    assert [too_fast(k, 2.0) for k in (2.0, 2.1, math.nan)] == [False, True, True]
    poses = (math.asin(0.2), -math.asin(0.2), 0.3, 0.1, math.nan)
    sines = [
        Motion(turn, 0.0, 0.0, 0.0, math.cos(turn), math.sin(turn), 1.0, 0.0) for turn in poses
    ]
    margin = abs(sines[0].sin_a)
    assert [singular(q, margin) for q in sines] == [False, False, False, True, True]


# --- what the hand does ---


@pytest.mark.parametrize("seed", DRAWS)
def test_sines_turn_and_keep_their_length_by_complex_numbers(seed: int):
    rng = np.random.default_rng([6, seed])
    vectors, turns = (rng.normal(size=5) + 1j * rng.normal(size=5) for _ in range(2))
    sines, turn = (Sines(*(UnitVector(v.real, v.imag) for v in each)) for each in (vectors, turns))
    turned = vectors * turns
    assert np.array(advance_sines(sines, turn)) == pytest.approx(
        np.array([turned.real, turned.imag]).T
    )
    near = vectors * (1.5 - 0.5 * abs(vectors) ** 2)
    assert np.array(renew_sines(sines)) == pytest.approx(np.array([near.real, near.imag]).T)
    amplitudes = rng.normal(size=5)
    assert sum_of_sines(PerSine(*amplitudes.tolist()), sines) == pytest.approx(
        amplitudes @ vectors.imag
    )


def test_a_task_is_accepted_if_all_its_starts_are_within_reach():
    rng, outcomes = np.random.default_rng(4), list[bool]()
    spread = np.linspace(-1.0, 1.0, 201)
    while outcomes.count(True) < 15 or outcomes.count(False) < 15:
        x, y, direction, offset = rng.uniform((-0.6, 0.1, -3.0, 0.03), (0.6, 1.0, 3.0, 0.09))
        path = Arc(x=x, y=y, direction=direction, radius=0.7, angle=0.1)
        try:
            check_machine(PathFollowing(path=path, error_max=0.1, truncation_error=0.1), BASELINE)
        except ParameterError:
            continue
        left = np.array([-math.sin(direction), math.cos(direction)])
        starts = np.array([x, y]) + offset * spread[:, None] * left
        least = float(sin_elbow(BASELINE.arm.length_a, BASELINE.arm.length_b, starts).min())
        task = PathFollowing(path=path, error_max=0.1, truncation_error=0.1, start_offset=offset)
        if abs(least - task.singularity_margin) < 1e-3:  # between two of those that are looked at
            continue
        outcomes.append(least > task.singularity_margin)
        if outcomes[-1]:
            check_machine(task, BASELINE)
        else:
            with pytest.raises(ParameterError, match="start_offset"):
                check_machine(task, BASELINE)


def test_a_start_is_as_far_to_either_side_as_drawn():
    assert [spread(draw, 0.2) for draw in (0.0, 0.25, 0.5, 1.0)] == pytest.approx(
        [-0.2, -0.1, 0.0, 0.2]
    )
    arm, angle = model_of(BASELINE).arm, 0.3
    world = np.zeros((ROWS, 1))
    store(world, ROW.machine.arm, 0, arm)
    place(world, 0, Vector(0.1, 0.5), UnitVector(math.cos(angle), math.sin(angle)), 0.02)
    start = complex(*tip_position(arm, load(world, ROW.motion, 0)))
    assert start == pytest.approx(complex(0.1, 0.5) + 0.02j * cmath.exp(1j * angle))


@pytest.mark.parametrize("seed", DRAWS)
def test_a_hand_pushes_pulls_to_its_target_and_plays_what_was_recorded(seed: int):
    arm = model_of(replace(BASELINE, hand=Hand(mass=1.0, damping=4.0, stiffness=10.0))).arm
    q = motion_at(arm, 0.1, 0.5)._replace(omega_a=0.3, omega_b=-0.2)
    target, velocity, recorded = (vector(seed + k) for k in (0, 10, 20))
    world, angle = np.zeros((ROWS, 1)), float(seed)
    store(world, ROW.machine.arm, 0, arm)
    store(world, ROW.motion, 0, q)
    store(world, ROW.foot.heading, 0, unit(angle))
    store(world, ROW.target, 0, Target(*(Vector(v.real, v.imag) for v in (target, velocity))))
    store(world, ROW.drive.force, 0, PathVector(recorded.real, recorded.imag))
    world[ROW.hand.push] = 5.0
    pull = 10.0 * (target - complex(*tip_position(arm, q))) + 4.0 * (
        velocity - complex(*tip_velocity(arm, q))
    )
    force = 5.0 + recorded + pull * cmath.exp(-1j * angle)
    assert hand_force(world, 0) == pytest.approx((force.real, force.imag))


def test_each_reading_has_noise_of_its_own():
    world, seed, episode = np.zeros((ROWS, 1)), np.uint64(3), np.uint64(4)
    store(world, ROW.task.sensing, 0, SensingModel(0.0, 0.5, 2.0, 3.0, 0.0, 0.0, 0.0))
    store(world, ROW.foot.heading, 0, unit(0.0))
    world[ROW.step] = 6.0
    take_reading(world, 0, seed, episode, 0.01)
    reading, draws = (
        load(world, ROW.readings.now, 0),
        [gaussians(seed, episode, k) for k in (12, 13)],
    )
    noise = [
        *np.array(reading.omega) / 0.5,
        *np.array(reading.force) / 3.0,
        *np.array(reading.torque) / 2.0,
    ]
    assert noise == pytest.approx([*draws[0], *draws[1]])
    assert len({abs(draw) for draw in noise}) == 8


def test_an_intent_gathers_speed_with_the_least_jerk():
    assert [intent_speed(t, 0.5, 2.0) for t in (0.0, 0.125, 0.25, 0.5, 0.75, 9.0)] == [
        0.0,
        0.3125,
        1.0,
        2.0,
        2.0,
        2.0,
    ]


def test_an_intent_goes_on_from_where_it_was_no_further_than_its_lead_before_the_tip():
    """Also where the tip has been further along the path than it is now."""
    rows, constants = np.zeros((ROWS, 1)), np.append(np.zeros(3), Line(x=0.1, y=0.5).arcs.table)
    hand = HumanArm().model(0.5, 1e-3, (0, 0))
    store(rows, ROW.hand, 0, hand)
    store(rows, ROW.task.path, 0, PathModel(3, 1, 0.8))
    rows[ROW.step], rows[ROW.reached] = 1e4, 0.5
    for foot, at in ((0.1, 0.1), (0.1, 0.1 + hand.intent_lead - 1e-4), (0.1, 0.45)):
        rows[ROW.foot.arc_length], rows[ROW.intent] = foot, at
        target = intended(rows, 0, constants, 0.01)
        moved = max(at, min(at + 0.01 * hand.intent_speed, foot + hand.intent_lead))
        assert target.position == pytest.approx(Line(x=0.1, y=0.5).point(at))
        assert math.hypot(*target.velocity) == pytest.approx((moved - at) / 0.01)
        assert rows[ROW.intent, 0] == pytest.approx(moved)


def test_a_passive_hand():
    *numbers, amplitude, phase, half_turn = NO_FORCE
    assert numbers == 7 * [0.0]
    assert amplitude == phase == (0.0,) * 5
    assert half_turn == ((1.0, 0.0),) * 5


@pytest.mark.parametrize(
    ("hand", "force"),
    [
        (MultiSineHand(push=-3.0, amplitudes=(1.0, -1.0, 2.0, 0.0, 0.0)), 5.0),
        (RecordedForces(times=(0.0, 1.0), along=(1.0, -5.0), across=(12.0, 1.0)), 13.0),
        (
            HumanArm(
                impedance=Hand(mass=1.0, damping=4.0, stiffness=10.0),
                eagerness=1.5,
                lead=0.25,
                amplitudes=(0.5, 0.0, 0.0, 0.0, -0.25),
            ),
            10.0 * (0.6 + 0.2 + 0.25) + 4.0 * 1.5 * 0.5 + 0.75,
        ),
    ],
)
def test_the_strongest_force_that_a_hand_can_have(hand: Any, force: float):
    """A spring is as long as the path, its width and the lead, and half as long again as the tip's
    way in a step."""
    machine = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.4, length_b=0.5))
    task = PathFollowing(hand=hand, pace=0.5, path=Line(length=0.6), error_max=0.2)
    travel = largest_travel(
        held_machine(task, machine).model.arm, machine.substep, task.control_period
    )
    assert strongest(task, machine) == pytest.approx(
        force + 0.5 * travel * hand.impedance.stiffness
    )
    folded = replace(task, path=Line(length=1.75))
    beyond = 2.0 * 0.9 - 0.8 if hand.impedance.stiffness > 0.0 else 0.0
    assert strongest(folded, machine) - strongest(task, machine) == pytest.approx(10.0 * beyond)


# --- what a control step pays ---


def test_reward_and_cost_of_a_pace():
    ratios = (-1.0, 0.0, 0.5, 1.0, 2.0, 60.0)
    assert [pace_share(ratio) for ratio in ratios] == pytest.approx(
        [0.0, 0.0, 0.125, 1.0, 1 / 16, 60.0**-4]
    )
    assert [pace_cost(ratio) for ratio in ratios] == [5.0, 5.0, 1.25, 0.0, 1.0, 49.0]


@pytest.mark.parametrize("failed", [False, True])
def test_each_reward_term_is_scaled_by_its_weight(failed: bool):
    at = PathState(0.0, -0.03, -0.03, unit(0.0), 0.0, PathVector(0.0, 0.0))
    volts = PerClutch(1.0, 2.0, 3.0, 4.0)
    seen = Outcome(
        at=at,
        advance=0.2,
        earned=30.0,
        path_length=0.8,
        pace=0.5,
        pace_ratio=0.5,
        acceleration=4.0,
        volts=volts,
        voltage_max=20.0,
        failed=failed,
    )
    none = Terms(*(0.0,) * len(Terms._fields))
    weights = {
        "tracking": 300.0,
        "precision": 700.0,
        "pace": 40.0,
        "acceleration": 5.0,
        "effort": 6.0,
        "failure": 7.0,
    }
    terms = reward_terms(none._replace(**weights), seen, 0.01)
    expected = none._replace(
        tracking=300.0 * 0.25 * 0.125 * math.exp(-0.03 / 0.06),
        precision=700.0 * 0.25 * 0.125 * math.exp(-0.03 / 0.006),
        pace=-40.0 * 1.25 * 0.01 * 0.5 / 0.8,
        acceleration=-5.0 * 4.0 / 10.0 * 0.01 * 0.5 / 0.8,
        effort=-6.0 * (1.0 + 4.0 + 9.0 + 16.0) / 4.0 / 400.0 * 0.01 * 0.5 / 0.8,
    )
    paid = 30.0 + expected.tracking + expected.precision
    expected = expected._replace(failure=-7.0 * paid if failed else 0.0)
    assert terms == pytest.approx(expected)
    assert total(terms) == pytest.approx(sum(expected))


def test_each_weight_of_the_reward():
    weights = {name: getattr(RewardWeights(), name) for name in Terms._fields}
    assert {name: weight for name, weight in weights.items() if weight != 0.0} == {
        "tracking": 100.0,
        "pace": 10.0,
        "effort": 20.0,
        "failure": 0.5,
    }


def test_the_allowance_is_what_half_of_the_tips_inertia_loses_and_two_time_constants():
    """The tip's inertia is that of the links, carried over by how their angles follow the tip."""
    arm, (x, y), heading = model_of(BASELINE).arm, Line().point(0.0), Line().heading(0.0)
    at, eps = motion_at(arm, x, y), 1e-6
    angles = [
        [
            (getattr(ahead, name) - getattr(behind, name)) / (2.0 * eps)
            for name in ("theta_a", "theta_b")
        ]
        for ahead, behind in (
            (motion_at(arm, x + eps, y), motion_at(arm, x - eps, y)),
            (motion_at(arm, x, y + eps), motion_at(arm, x, y - eps)),
        )
    ]
    coupling = arm.coupling * math.cos(at.theta_a - at.theta_b)
    inertia = (
        np.array(angles) @ np.array([[arm.m11, coupling], [coupling, arm.m22]]) @ np.array(angles).T
    )
    along = np.array([math.cos(heading), math.sin(heading)])
    mass = 1.0 / (along @ np.linalg.inv(inertia) @ along)
    lost = 0.5 * mass * PathFollowing().pace / MultiSineHand().push
    assert start_up_allowance() == pytest.approx(
        2.0 * BASELINE.clutch.time_constant + lost, rel=1e-7
    )


def test_the_allowance_is_for_the_first_hundredth_of_a_path():
    until = ALLOWANCE + 0.02 / 0.5
    assert in_start_up(0.02, 2.0, 0.5, until)
    assert not in_start_up(0.0200001, 2.0, 0.5, until)
    assert not in_start_up(0.0, 2.0, 0.5, until + 1e-9)


# --- what is observed and told ---


def test_an_observation_has_the_declared_entries():
    q = Motion(0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    arm = model_of(BASELINE).arm
    volts, torque, force = (
        PerClutch(1.0, 2.0, 3.0, 4.0),
        PerClutch(5.0, 6.0, 7.0, 8.0),
        PathVector(9.0, 10.0),
    )

    def seen(offset: float) -> Any:
        foot = Foot(0.3, offset, unit(0.2), 7.0, 2.0)
        measured = Measurement(q, foot, torque, force)
        return observation(measured, arm, FreeBand(0.003, 0.001), 1.5, 0.4, volts)

    v_x, v_y = tip_velocity(arm, q)
    speed = complex(v_x, v_y) / cmath.exp(0.2j)
    expected = {
        "cos_a": 3.0,
        "sin_a": 4.0,
        "cos_b": 5.0,
        "sin_b": 6.0,
        "omega_a": 1.0,
        "omega_b": 2.0,
        "normal_error": pytest.approx(0.003),
        "near_error": 0.004,
        "progress": pytest.approx(0.2),
        "heading": unit(0.2),
        "curvature": 7.0,
        "speed": pytest.approx((speed.real, speed.imag)),
        "pace": 0.4,
        "pace_error": pytest.approx(speed.real / 0.4 - 1.0),
        "volts": volts,
        "torque": torque,
        "force": force,
    }
    assert {name: getattr(seen(0.004), name) for name in expected} == expected
    assert [seen(offset).near_error for offset in (0.5, -0.5)] == [0.01, -0.01]


def test_a_reading_is_projected_from_the_arc_that_the_tip_is_on():
    """Of two legs side by side, the tip is nearer to the first, and on its way along the other."""
    path = Polyline(points=((-0.2, 0.5), (0.2, 0.5), (0.2, 0.6), (-0.2, 0.6)), radius=0.04)
    arm, table = model_of(BASELINE).arm, path.arcs.table
    at = motion_at(arm, 0.0, 0.54)
    still = PerLink(0.0, 0.0)
    reading = Reading(PerLink(*at[:2]), still, PerClutch(0.0, 0.0, 0.0, 0.0), PathVector(0.0, 0.0))
    feet = [
        measurement_of(reading, arm, np.append(np.zeros(3), table), 3, len(table), segment).foot
        for segment in (0, len(table) - 1)
    ]
    assert [foot.segment for foot in feet] == [0, len(table) - 1]
    assert [foot.arc_length for foot in feet] == pytest.approx([0.2, path.length - 0.2])
    assert [foot.normal_error for foot in feet] == pytest.approx([0.04, 0.06])


def test_observed_context_of_machine_and_task():
    twice = Clutch(
        breakaway=BASELINE.clutch.breakaway.scaled(2.0),
        dynamic=BASELINE.clutch.dynamic.scaled(3.0),
        time_constant=0.07,
    )
    machine = replace(BASELINE, clutch=twice, clutch_scale=(0.5, 1.0, 1.5, 3.0))
    arm = HumanArm(impedance=Hand(mass=1.0, damping=4.0, stiffness=10.0))
    task = PathFollowing(hand=arm, friction_drift=0.02, path=Arc(radius=2.0))
    told = context_of(task, machine, (5, 6), (7, 8)).told
    assert told == pytest.approx((0.07, 1.5 * 2.0, 1.5 * 3.0, 0.02, 1.0, 4.0, 10.0, 0.0))
    context = context_of(task, machine, (5, 6), (7, 8))
    assert context.task.path == (5, 6, task.path.length)
    assert context.task.pace_decay == pytest.approx(1.0 - math.exp(-0.1))
    assert context.task.sensing.is_ideal == 1.0
    assert (
        context_of(
            replace(task, sensing=Sensing(delay=1)), machine, (0, 0), (0, 0)
        ).task.sensing.is_ideal
        == 0.0
    )
    assert context.told.hand_push == context.hand.push == 0.0


def test_scales_are_those_that_trained_policies_have_seen():
    layout = observation_layout(BASELINE, "force")
    expected = {
        "omega": 0.5,
        "normal": 0.01,
        "near": 0.01,
        "curvature": 5.0,
        "speed": 0.2,
        "pace": 0.2,
    }
    expected |= {"pace_error": 1.0, "volts": 24.0, "torque": 20.0, "force": 50.0}
    scales = [expected.get(name, expected.get(name.split("_")[0], 1.0)) for name in layout.names]
    assert layout.scales.tolist() == pytest.approx(scales)


def test_there_are_no_other_sensors():
    with pytest.raises(ParameterError, match="sensors"):
        observation_layout(BASELINE, "eyes")  # pyright: ignore[reportArgumentType]


LAST_ROWS: dict[Reason | None, dict[str, float]] = {
    None: {"terminated": 0.0, "normal_error": 9.0},
    Reason.ARRIVED: {"is_success": 1.0, "arc_length": 0.5},
    Reason.MISSED: {"arc_length": 0.5, "normal_error": 0.15},
    Reason.STRAYED: {"arc_length": 0.2, "normal_error": -0.21},
    Reason.SINGULAR: {"arc_length": 0.2, "normal_error": 0.19},
    Reason.TOO_FAST: {"kinetic_energy": 1e9, "arc_length": 0.5, "normal_error": 0.15},
}


@pytest.mark.parametrize("reason", LAST_ROWS)
def test_the_last_row_of_an_episode_tells_why_it_ended(reason: Reason | None):
    row = np.zeros(len(TELEMETRY))
    for name, value in {"terminated": 1.0, **LAST_ROWS[reason]}.items():
        row[TELEMETRY.index(name)] = value
    assert reason_of(row, BASELINE, PathFollowing(path=Line(length=0.5), error_max=0.2)) == reason


def test_telemetry_is_in_si():
    assert (TELEMETRY.scales == 1.0).all()


# --- what is accepted ---

MAKE: dict[str, Callable[[float], Any]] = {
    "pace": lambda x: PathFollowing(pace=x),
    "control_period": lambda x: PathFollowing(control_period=x),
    "error_max": lambda x: PathFollowing(error_max=x),
    "truncation_error": lambda x: PathFollowing(truncation_error=x),
    "friction_drift": lambda x: PathFollowing(friction_drift=x),
    "singularity_margin": lambda x: PathFollowing(singularity_margin=x),
    "angle_resolution": lambda x: Sensing(angle_resolution=x),
    "delay": lambda x: Sensing(delay=x),  # type: ignore[arg-type]
    "moving": lambda x: Starts(moving=x),
    "gripped": lambda x: Starts(moving=0.25, gripped=x),
    "offset": lambda x: Starts(offset=x),
}

ACCEPTED: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "pace": ((1e-12, 5.0), (0.0, 5.001)),
    "control_period": ((1.0,), (0.0, 1.001)),
    "error_max": ((0.25,), (0.0, 0.251)),
    "truncation_error": ((0.5,), (0.0, 0.501)),
    "friction_drift": ((-1.0, 1.0), (-1.001, 1.001)),
    "singularity_margin": ((0.999,), (0.0, 1.0)),
    "angle_resolution": ((0.0, 0.1), (-0.001, 0.101)),
    "delay": ((0, 2), (-1, 3, 0.5)),
    "moving": ((0.0, 1.0), (-0.001, 1.001)),
    "gripped": ((0.0, 0.75), (-0.001, 0.751)),
    "offset": ((0.0, 0.25), (-0.001, 0.251)),
}
"""By field what is accepted, and what is not."""


def test_ranges_end_where_they_say():
    for field, (good, bad) in ACCEPTED.items():
        for number in good:
            MAKE[field](number)
        for number in bad:
            with pytest.raises(ParameterError, match=field):
                MAKE[field](number)


def test_task_defaults():
    task = PathFollowing()
    assert (task.friction_drift, task.start_offset, task.sensing.delay) == (0.0, 0.0, 0)
    assert (task.error_max, task.truncation_error, task.arrival) == (0.25, 0.5, 0.125)
    assert task.starts == Starts(moving=0.0, gripped=0.0, offset=0.05)


def test_the_elbows_sine_by_the_arm_at_a_tip():
    arm = Linkage(
        length_a=0.4,
        length_b=0.7,
        m11=0.3,
        m22=0.5,
        coupling=0.2,
        damping=0.0,
        stiffness=0.0,
        implicit=0.5,
    )
    tips = [(0.3, 0.6), (-0.5, 0.2), (0.1, -0.9)]
    poses = [motion_at(arm, *tip) for tip in tips]
    expected = [math.sin(q.theta_b - q.theta_a) for q in poses]
    assert sin_elbow(0.4, 0.7, np.array(tips)) == pytest.approx(expected)
    out_of_reach = np.array([(1.2, 0.0), (0.1, 0.1)])
    assert sin_elbow(0.4, 0.7, out_of_reach).tolist() == [-1.0, -1.0]


@pytest.mark.parametrize(
    ("ratio", "count"),
    [
        (0.5, 1),
        (1, 1),
        (1.5, 2),
        (7, 7),
        (7.0 + 1e-9, 7),
        (7.0 + 1e-7, 8),
        (MAX_SUBSTEPS, MAX_SUBSTEPS),
    ],
)
def test_substeps_of_a_control_period(ratio: float, count: int):
    machine, task = replace(BASELINE, substep=1e-5), PathFollowing(control_period=ratio * 1e-5)
    assert substeps(task, machine) == count
    assert held_machine(task, machine).machine.substep == pytest.approx(
        ratio * 1e-5 / count, rel=1e-12
    )


def test_a_control_period_of_too_many_substeps_is_refused():
    with pytest.raises(ParameterError, match="control_period"):
        check_machine(
            PathFollowing(control_period=(MAX_SUBSTEPS + 1) * 1e-5), replace(BASELINE, substep=1e-5)
        )


def test_a_sine_may_be_as_fast_as_a_tenth_of_the_substeps_rate():
    for rate, refused in ((0.1, False), (0.1001, True)):
        hand = MultiSineHand(frequencies=(1.0, 1.0, 1.0, 1.0, rate / BASELINE.substep))
        if refused:
            with pytest.raises(ParameterError, match=r"hand\.frequencies"):
                check_machine(PathFollowing(hand=hand), BASELINE)
        else:
            check_machine(PathFollowing(hand=hand), BASELINE)
    check_machine(
        PathFollowing(hand=RecordedForces(times=(0.0,), along=(0.0,), across=(0.0,))), BASELINE
    )


@pytest.mark.parametrize("field", ["path", "hand", "starts", "sensing"])
def test_a_part_of_another_kind_is_refused(field: str) -> None:
    with pytest.raises(ParameterError, match=field):
        PathFollowing(**{field: 3})  # type: ignore[arg-type]


def test_an_episode_may_begin_as_fast_as_the_integrator_can_hold():
    machine = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.4, length_b=0.6), substep=1e-2)
    arm = model_of(machine).arm
    path = Line(x=-0.1, y=0.5, direction=0.0, length=0.2)
    weak = MultiSineHand(push=1.0, amplitudes=(0.0,) * 5)
    task = PathFollowing(path=path, hand=weak, starts=Starts(moving=1.0), control_period=0.2)
    # links at up to √(2² + ½²) times the pace over margin and length
    rates = math.hypot(2.0, 0.5) / task.singularity_margin / np.array([0.4, 0.6])
    energy = (
        0.5 * (arm.m11 * rates[0] ** 2 + arm.m22 * rates[1] ** 2)
        + abs(arm.coupling) * rates[0] * rates[1]
    )
    fastest = math.sqrt(largest_energy(arm, 1e-2, 0.2, strongest(task, machine)) / energy)
    check_machine(replace(task, pace=fastest * (1.0 - 1e-9)), machine)
    with pytest.raises(ParameterError, match="starts"):
        check_machine(replace(task, pace=fastest * (1.0 + 1e-9)), machine)


def test_a_torque_curve_is_told_at_the_largest_voltage():
    straight = TorqueCurve(slope=1.0, knee=100.0, curvature=0.0)
    machine = replace(
        BASELINE, clutch=Clutch(breakaway=straight, dynamic=straight, voltage_max=6.0)
    )
    told = context_of(PathFollowing(), machine, (0, 0), (0, 0)).told
    scale = sum(machine.clutch_scale) / 4.0
    assert told.breakaway_factor == pytest.approx(
        scale * 6.0 / BASELINE.clutch.breakaway.torque(6.0)
    )


def test_a_reset_tells_the_force_that_it_shows() -> None:
    """In world axes, and along and across the path."""
    batch = Batch(BASELINE, PathFollowing(), 4, sensors="force")
    obs, telemetry = batch.reset([0, 1, 2, 3])
    at = [batch.layout.index(f"force_{name}") for name in ("along", "across")]
    shown = np.hypot(*(obs[:, at] * batch.layout.scales[at]).T)
    assert np.hypot(*telemetry[:, [*COLUMN.force]].T) == pytest.approx(shown, rel=1e-6)
    assert (shown > 1.0).all()


def test_an_episode_that_begins_moving_has_its_hand_and_encoders_with_it() -> None:
    """The intent is beside the tip, and encoders read the velocity that it has."""
    sensing = Sensing(angle_resolution=1e-7, encoder_velocity=True, delay=2)
    task = PathFollowing(hand=HumanArm(), starts=Starts(moving=1.0, offset=0.0), sensing=sensing)
    batch = Batch(BASELINE, task, 4)
    obs, telemetry = batch.reset([0, 1, 2, 3])
    state = batch.get_worlds()
    np.testing.assert_allclose(state.target.position.x, telemetry[:, COLUMN.tip.x], atol=1e-9)
    np.testing.assert_allclose(state.target.position.y, telemetry[:, COLUMN.tip.y], atol=1e-9)
    for name in ("omega_a", "omega_b"):
        at = batch.layout.index(name)
        read, omega = obs[:, at] * batch.layout.scales[at], getattr(state.motion, name)
        assert (np.abs(omega) > 1e-3).all()
        np.testing.assert_allclose(read, omega, rtol=1e-6, atol=1.1e-7 / task.control_period)


def test_the_acceleration_that_is_paid_for_is_the_change_of_the_tips_velocity() -> None:
    """Along both axes, of a tip that begins at rest."""
    task = PathFollowing(
        path=Line(x=-0.3, y=0.5, direction=0.7, length=0.2), reward=RewardWeights(acceleration=5.0)
    )
    batch = Batch(BASELINE, task)
    batch.reset([0])
    row = batch.step(np.zeros((1, 4))).telemetry[0, 0]
    change = row[[*COLUMN.tip_velocity]] / task.control_period
    assert (np.abs(change) > 0.1).all()
    assert row[[*COLUMN.acceleration]] == pytest.approx(change)
    share = task.control_period * task.pace / task.path.length
    assert row[COLUMN.terms.acceleration] == pytest.approx(
        -5.0 * math.hypot(*change) / 10.0 * share
    )
