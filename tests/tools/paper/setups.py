"""Machines, paths and hands that PTER may have had, where the paper is silent."""

from dataclasses import replace

import numpy as np

from pter_gym.hands import eq5
from pter_gym.params import BASELINE, Arm, TorqueCurve, with_friction
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tools.paper.parameters import BREAKAWAY_SMALL_VOLTAGE, SETUP, Setup


def other_setup(seed: int) -> Setup:
    """Return other machines, path, hand and gains; what the paper prints of single clutches
    holds."""
    u = np.random.default_rng(seed).uniform
    a, b, inertia_a, inertia_b = u(0.3, 0.66), u(0.3, 0.66), u(0.25, 2.0), u(0.25, 2.0)
    coupling = u(-0.6, 0.6) * np.sqrt(inertia_a * inertia_b)
    arm = Arm(length_a=a, length_b=b, inertia_a=inertia_a, inertia_b=inertia_b, coupling=coupling)
    ratio, knee = u(1.12, 1.5), u(8.0, 22.0)
    slope = BREAKAWAY_SMALL_VOLTAGE / (ratio * u(4.0, 8.0))
    dynamic = TorqueCurve(slope=slope, knee=knee, curvature=u(0.0, 1.5) * slope / (24.0 - knee))
    present = replace(BASELINE.clutch, dynamic=dynamic, breakaway=dynamic.scaled(ratio))
    scale, delrin_ratio = u(0.5, 0.95), max(1.12, 1.0 + u(0.65, 1.6) * (ratio - 1.0))
    clutches = {
        "baseline": present,
        "delrin_experimental": with_friction(present, scale * delrin_ratio / ratio, scale),
        "delrin_theoretical": with_friction(present, 0.20 / 0.45, 0.35 / u(0.37, 0.45)),
    }
    near, far = (np.sqrt(a * a + b * b + 2.0 * cos * a * b) for cos in (-0.91, 0.91))
    y = near + u(0.1, 0.8) * (far - near)
    length = min(u(0.4, 1.2), 1.96 * np.sqrt(far * far - y * y))
    return Setup(
        machines={
            name: replace(BASELINE, arm=arm, clutch=clutch) for name, clutch in clutches.items()
        },
        task=PathFollowing(
            path=Line(x=-0.5 * length, y=y, direction=0.0, length=length),
            hand=eq5(u(5.0, 60.0), u(20.0, 60.0)),
        ),
        controller=replace(SETUP.controller, stiffness=u(100.0, 3000.0)),
        table_error=u(0.7, 1.4),
        delrin_table=u(0.5, 1.5),
        time_constants=(0.03, 0.06, 0.105, 0.2),
    )
