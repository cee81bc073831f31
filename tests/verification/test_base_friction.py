"""Friction of the axes against the base: closed forms, and what it must leave as it is.

``test_order.py`` compares whole motions with the event-driven reference.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import with_dry, without_dry
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym._physics.stability import condition
from pter_gym.errors import ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, Clutch, Machine
from pter_gym.paths import Line
from pter_gym.tasks.path_following import COLUMN, PathFollowing

ALONE = replace(BASELINE.arm, coupling=0.0)
"""Links that do not feel each other."""

POSE = (0.7, 2.2)


def with_friction(substep: float = 1e-4, **friction: float) -> Machine:
    return replace(BASELINE, arm=replace(ALONE, **friction), substep=substep)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("substep", [2.5e-3, 1e-4])
def test_an_axis_coasts_to_rest_as_the_closed_form_does(axis: int, substep: float):
    """m·dω/dt = −b − d·ω.

    An implicit substep is (1 + x)⁻¹ for e⁻ˣ, x = h·d/m: n of them are off by at most n·x²/2.
    """
    dry, viscous, begin = 0.4, 0.2, 2.0
    names = ("dry_a", "viscous_a") if axis == 0 else ("dry_b", "viscous_b")
    machine = with_friction(substep, **dict(zip(names, (dry, viscous), strict=True)))
    inertia = (ALONE.inertia_a, ALONE.inertia_b)[axis]
    rest = inertia / viscous * np.log(1.0 + begin * viscous / dry)
    omega = np.eye(2)[axis] * begin
    run = simulate(
        machine, initial_state(machine, POSE, omega), np.zeros(4), (0.0, 0.0), duration=1.2 * rest
    )
    exact = (begin + dry / viscous) * np.exp(-run.time * viscous / inertia) - dry / viscous
    x = substep * viscous / inertia
    bound = (begin + dry / viscous) * 0.5 * (run.time / substep) * x**2 + 1e-12
    moves = run.time < rest - substep - bound[-1] * inertia / dry
    assert moves.sum() > 0.8 * len(run.time) / 1.2
    assert np.all(np.abs(run.omega[:, axis] - exact)[moves] <= bound[moves])
    assert np.all(run.omega[run.time > rest + substep + bound[-1] * inertia / dry, axis] == 0.0)
    assert np.all(run.omega[:, 1 - axis] == 0.0)


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.001, True)])
def test_dry_friction_holds_up_to_its_torque(share: float, moves: bool):
    machine = with_friction(dry_a=0.4)
    start = initial_state(machine, POSE)
    run = simulate(
        machine, start, np.zeros(4), (0.0, 0.0), joint_torque=(share * 0.4, 0.0), duration=0.05
    )
    speed = (share - 1.0) * 0.4 / ALONE.inertia_a * run.time if moves else np.zeros(len(run.time))
    assert run.omega[:, 0] == pytest.approx(speed, abs=1e-13)


def test_dry_friction_is_a_clutch_that_is_always_on():
    """At 5 V a clutch 1 with T_s = T_k brakes as dry friction of the same torque does; its own
    torque is not told."""
    curve = replace(BASELINE.clutch.dynamic, knee=20.0)
    clutch = Clutch(breakaway=curve, dynamic=curve)
    braked = replace(BASELINE, clutch=clutch)
    rubbing = replace(braked, arm=replace(BASELINE.arm, dry_a=curve.torque(5.0)))
    time = np.arange(400) * BASELINE.substep
    force = 14.0 * np.stack([np.sin(9.0 * time), np.cos(7.0 * time)], axis=1)
    others = np.array([0.0, 3.0, 4.0, 0.0])
    one = np.array([5.0, 3.0, 4.0, 0.0])
    by_clutch = simulate(braked, initial_state(braked, POSE, volts=one), one, force)
    by_base = simulate(rubbing, initial_state(rubbing, POSE, volts=others), others, force)
    assert len(set(by_clutch.mode.tolist())) >= 3
    assert by_base.theta == pytest.approx(by_clutch.theta, abs=1e-12)
    assert by_base.dissipated == pytest.approx(by_clutch.dissipated, abs=1e-12)
    assert np.all(by_base.torque[:, 0] == 0.0)
    slips = by_clutch.omega[:, 0] != 0.0
    assert by_base.torque[slips, 1:] == pytest.approx(by_clutch.torque[slips, 1:], abs=1e-9)


def test_the_clutches_torques_are_their_own():
    machine = with_friction(dry_a=0.7, dry_b=0.3)
    volts = np.array([6.0, 0.0, 0.0, 0.0])
    start = initial_state(machine, POSE, (3.0, 0.0), volts)
    run = simulate(machine, start, volts, (0.0, 0.0), duration=0.01)
    assert run.torque[:, 0] == pytest.approx(
        np.full(100, -BASELINE.clutch.dynamic.torque(6.0)), rel=1e-9
    )
    assert np.all(run.power <= 0.0)
    together = with_dry(PerClutch(2.0, 0.0, 5.0, 6.0), 0.5, 1.5)
    assert together == (2.5, 1.5, 5.0, 6.0)
    assert without_dry(PerClutch(-2.5, 0.75, 5.0, 0.1), 0.5, 1.5) == (-2.0, 0.0, 5.0, 0.1)
    assert without_dry(PerClutch(0.0, 0.0, 0.0, 0.0), 0.0, 0.0) == (0.0,) * 4


def test_energies_add_up():
    arm = replace(BASELINE.arm, dry_a=0.6, dry_b=0.4, viscous_a=0.3, viscous_b=0.5)
    machine = replace(BASELINE, arm=arm)
    time = np.arange(800) * machine.substep
    force = 50.0 * np.stack([np.sin(5.0 * time), np.cos(4.0 * time)], axis=1)
    volts = np.array([2.0, 0.0, 3.0, 0.0])
    run = simulate(machine, initial_state(machine, POSE, volts=volts), volts, force)
    gained = run.hand_work - run.dissipated - run.numerical_loss + run.residual
    rounding = 1e-12 * len(time)
    assert np.abs(np.diff(run.kinetic_energy) - gained[1:]).max() < rounding
    without = simulate(BASELINE, initial_state(BASELINE, POSE, volts=volts), volts, force)
    assert run.dissipated.sum() > without.dissipated.sum()
    assert np.all(run.dissipated >= 0.0)


def test_worlds_apply_dry_friction():
    """A world moves as the open-loop simulation does, from torques at rest on, up to rounding."""
    machine = replace(
        BASELINE, arm=replace(BASELINE.arm, dry_a=0.6, dry_b=0.4, viscous_a=0.3, viscous_b=0.5)
    )
    hand = MultiSineHand(push=12.0, amplitudes=(0.0,) * 5)
    task = PathFollowing(path=Line(x=-0.3, y=0.6, direction=0.0, length=0.6), hand=hand)
    count = round(task.control_period / machine.substep)
    batch = Batch(machine, task)
    _, first = batch.reset([0])
    rows = np.array([batch.step([[2.0, 0.0, 1.0, 0.0]]).telemetry[0, 0] for _ in range(25)])
    start = initial_state(machine, first[0, [*COLUMN.theta]])
    run = simulate(
        machine, start, (2.0, 0.0, 1.0, 0.0), (12.0, 0.0), duration=25 * task.control_period
    )
    assert rows[:, [*COLUMN.theta]] == pytest.approx(run.theta[count - 1 :: count], abs=1e-10)
    assert rows[:, COLUMN.energy.dissipated] == pytest.approx(
        run.dissipated.reshape(-1, count).sum(axis=1), abs=1e-10
    )
    dynamic = BASELINE.clutch.dynamic.torque(2.0) * (
        1.0 - np.exp(-0.25 / BASELINE.clutch.time_constant)
    )
    assert rows[-1, COLUMN.mode] == 0.0
    assert abs(rows[-1, COLUMN.torque.x1]) == pytest.approx(dynamic, rel=1e-9)


def test_negative_friction_of_an_axis_is_refused():
    for name in ("dry_a", "dry_b", "viscous_a", "viscous_b"):
        with pytest.raises(ParameterError, match=rf"Arm\.{name}"):
            replace(BASELINE.arm, **{name: -1e-9})
    stiff = model_of(replace(BASELINE, arm=replace(BASELINE.arm, viscous_a=100.0))).arm
    usual = model_of(BASELINE).arm
    assert condition(stiff, 0.01) - condition(usual, 0.01) == pytest.approx(
        0.01
        * 100.0
        / np.linalg.eigvalsh([[usual.m11, usual.coupling], [usual.coupling, usual.m22]])[0]
    )
