"""A second reference: friction of a real axis, as printed, from a log made of the printed numbers.

EMPS is an electro-mechanical axis with dry and viscous friction whose parameters are printed
(Janot, Gautier and Brunot, 2019). Its measured signals are not used here: the moves are ours, and
the force is what the printed model needs for them, M·q̈ + Fv·q̇ + Fc·sign(q̇). So this shows that
``identify`` and its model of an axis agree with numbers and a formula of others; it does not show
that they explain EMPS."""

from dataclasses import replace

import numpy as np
import pytest

from pter_gym.params import BASELINE
from pter_gym.tools.identification import Log, identify

MASS, VISCOUS, DRY = 95.1089, 203.5034, 20.3935
"""Printed: M [kg], Fv [N·s/m], Fc [N]."""

LENGTH = 1.0
"""Of link A [m]: an angle of 1 rad is a way of 1 m, and the axis has M·LENGTH² as its inertia."""

LINK_B = 0.5 * np.pi
"""Angle of link B, which stays at rest: the force points along it, so it has no torque about its axis [rad]."""

INTERVAL = 2e-3


def moves() -> np.ndarray:
    """Return position [m], velocity [m/s] and acceleration [m/s²] of moves back and forth with rests, shape (3, T)."""
    place, parts = -0.1, [np.tile([[-0.1], [0.0], [0.0]], 250)]
    for duration in (2.0, 1.5, 1.0, 0.8, 0.6):
        for way in (0.2, -0.2):
            rate = 2.0 * np.pi / duration
            phase = rate * np.arange(INTERVAL, duration, INTERVAL)
            moved = place + way * (phase - np.sin(phase)) / (2.0 * np.pi)
            speed = way / duration
            parts.append(
                np.array([moved, speed * (1.0 - np.cos(phase)), speed * rate * np.sin(phase)])
            )
            place += way
            parts.append(np.tile([[place], [0.0], [0.0]], 150))
    return np.concatenate(parts, axis=1)


def emps_log() -> Log:
    """Return the log of those moves, with an encoder's steps and noise of the force."""
    rng = np.random.default_rng(0)
    q, velocity, acceleration = moves()
    torque = LENGTH * (MASS * acceleration + VISCOUS * velocity + DRY * np.sign(velocity))
    along_b = torque / (LENGTH * np.sin(LINK_B - q / LENGTH))
    force = along_b[:, None] * [np.cos(LINK_B), np.sin(LINK_B)] + rng.normal(0.0, 0.3, (len(q), 2))
    step = 2.0 * np.pi / 2**17
    theta = step * np.round(np.column_stack([q / LENGTH, np.full(len(q), LINK_B)]) / step)
    return Log(
        interval=INTERVAL,
        volts=np.zeros((len(q), 4)),
        theta=theta,
        force=force,
        name="EMPS, as printed",
    )


@pytest.mark.long
def test_the_printed_friction_of_an_axis_is_found():
    start = replace(BASELINE, arm=replace(BASELINE.arm, length_a=LENGTH, inertia_a=50.0))
    found = identify(emps_log(), start)
    assert found.verdict.share == 0.0
    findings = {each.quantity.name: each for each in found.findings}
    for name, printed in (("inertia_a", MASS), ("viscous_a", VISCOUS), ("dry_a", DRY)):
        finding = findings.pop(name)
        assert finding.status == "identified"
        assert finding.quantity.value == pytest.approx(printed, rel=0.005)
        assert finding.low <= printed <= finding.high
    assert {each.status for each in findings.values()} == {"kept"}
