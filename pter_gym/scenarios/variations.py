"""What varies in the scenarios: hands, paths, clutches, arms and sensors, each a distribution."""

import math
from dataclasses import replace
from types import MappingProxyType

from pter_gym.hands import (
    LIBRARY_ARMS,
    LIBRARY_TREMORS,
    NORMAL,
    RELAXED,
    SINES,
    TENSE,
    HumanArm,
    MultiSineHand,
)
from pter_gym.hands._operators import EQ5_FREQUENCIES
from pter_gym.hands._tremor import KINDS
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL
from pter_gym.paths import Arc, Circle, Line, Polyline, Sine, Spline
from pter_gym.scenarios.distributions import Draws, LogUniform, OneOf, Shared, Uniform, Vary
from pter_gym.scenarios.paces import PACES
from pter_gym.tasks.path_following import PathFollowing, Sensing

CURVED_WIDTH = 0.1
"""Half-width of the workspace about curved paths [m]: at most 0.9 of their smallest radius."""

MIN_RADIUS = 0.13
"""Smallest radius of a drawn arc or rounded corner [m]."""

EQ5 = MultiSineHand(random_phases=True)
"""The paper's hand with phases drawn at each reset."""

FORCES = Vary(
    EQ5,
    push=Uniform(45.0, 75.0),
    amplitudes=(Uniform(2.0, 7.0),) * SINES,
    frequencies=(LogUniform(min(EQ5_FREQUENCIES), max(EQ5_FREQUENCIES)),) * SINES,
)
"""A push along the path, and five sines across it of any amplitude, frequency and phase."""

HUMANS = OneOf(
    tuple(
        Vary(
            HumanArm(impedance=impedance, random_phases=True),
            eagerness=Uniform(1.3, 1.7),
            rise=Uniform(0.2, 0.5),
            amplitudes=(Uniform(1.0, 5.0),) * SINES,
        )
        for impedance in (RELAXED, NORMAL, TENSE)
    )
)
"""A relaxed, normal or tense human arm."""

LIBRARY = OneOf(tuple(arm.hand for arm in LIBRARY_ARMS.values()))
"""Mass, damper and spring of an arm of the library."""

TREMBLING = OneOf(
    tuple(
        Vary(
            kind(random_phases=True),
            impedance=LIBRARY,
            eagerness=Uniform(1.3, 1.7),
            rise=Uniform(0.2, 0.5),
            frequency=Uniform(*LIBRARY_TREMORS[name].band),
            acceleration=LogUniform(*LIBRARY_TREMORS[name].acceleration),
            direction=Uniform(-0.5 * math.pi, 0.5 * math.pi),
            phase=Uniform(0.0, 2.0 * math.pi),
            swell=Uniform(0.0, 0.6),
            swell_frequency=Uniform(0.2, 1.0),
            swell_phase=Uniform(0.0, 2.0 * math.pi),
        )
        for name, kind in KINDS.items()
    )
)
"""An arm of the library with a physiological, an essential or a Parkinsonian tremor."""


def _points(*boxes: tuple[float, float, float, float]) -> tuple[tuple[Uniform, Uniform], ...]:
    """Return waypoints drawn from boxes (x from, x to, y from, y to) [m]."""
    return tuple((Uniform(x0, x1), Uniform(y0, y1)) for x0, x1, y0, y1 in boxes)


CURVES = OneOf(
    (
        Vary(
            Line(),
            x=Uniform(-0.65, -0.45),
            y=Uniform(0.55, 0.8),
            direction=Uniform(-0.2, 0.2),
            length=Uniform(0.6, 1.0),
        ),
        Vary(
            Arc(),
            x=Uniform(-0.5, -0.1),
            y=Uniform(0.4, 0.7),
            direction=Uniform(-0.5, 1.0),
            radius=Uniform(0.2, 0.6),
            angle=OneOf((Uniform(-2.0, -1.0), Uniform(1.0, 2.0))),
        ),
        Vary(
            Circle(),
            center_x=Uniform(-0.2, 0.2),
            center_y=Uniform(0.5, 0.65),
            radius=Uniform(MIN_RADIUS, 0.2),
            start=Uniform(-math.pi, math.pi),
            clockwise=OneOf((False, True)),
        ),
        Vary(
            Sine(),
            x=Uniform(-0.6, -0.4),
            y=Uniform(0.6, 0.72),
            extent=Uniform(0.7, 0.95),
            amplitude=Uniform(0.02, 0.06),
            periods=Uniform(0.75, 1.5),
        ),
        Vary(
            Spline(points=((-0.5, 0.65), (0.4, 0.65))),
            points=_points(
                (-0.6, -0.45, 0.55, 0.75),
                (-0.3, -0.1, 0.5, 0.75),
                (0.1, 0.3, 0.5, 0.75),
                (0.45, 0.6, 0.55, 0.75),
            ),
        ),
        Vary(
            Polyline(points=((-0.5, 0.6), (0.0, 0.7), (0.5, 0.6)), radius=MIN_RADIUS),
            points=_points((-0.55, -0.45, 0.5, 0.7), (-0.1, 0.1, 0.6, 0.8), (0.4, 0.55, 0.5, 0.7)),
            radius=Uniform(MIN_RADIUS, 0.25),
        ),
    )
)
"""Lines, arcs, circles, sines, splines through four waypoints, and rounded corners."""

ANY_CLUTCHES = OneOf(
    tuple(
        Vary(machine.clutch, time_constant=LogUniform(0.03, 0.2))
        for machine in (BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL)
    )
)
"""The paper's three clutch materials, with a time constant of 0.03 to 0.2 s."""

TORQUE_ERRORS = Shared(LogUniform(0.75, 1.33), LogUniform(0.9, 1.11), 4)
"""Clutch torques over those of the curves: a factor for all, and each clutch's own."""

FRICTION_DRIFT = Uniform(-0.015, 0.015)
"""Change of the clutch torques in a second of an episode."""

ARMS = Vary(BASELINE.arm, inertia_a=Uniform(0.36, 0.6), inertia_b=Uniform(0.8, 1.3))
"""The arm with other inertias: another handle, other rotors."""

SENSORS = Vary(
    Sensing(),
    angle_resolution=OneOf((2.0 * math.pi / 16384, 2.0 * math.pi / 4096)),
    velocity_noise=Uniform(0.0, 0.02),
    torque_noise=Uniform(0.0, 1.0),
    force_noise=Uniform(0.0, 1.0),
    delay=OneOf((0, 1, 2)),
)
"""Encoders of 12 or 14 bit, noise, and up to two control steps of delay."""

STANDARD = PathFollowing(hand=EQ5)

LEANING = MultiSineHand(
    push=40.0,
    amplitudes=(12.0, 8.0, 4.0, 2.0, 2.0),
    frequencies=(0.0, 0.5, 1.0, 2.0, 4.0),
    phases=(-0.5 * math.pi, 0.0, 0.0, 0.0, 0.0),
)
"""A hand that pushes along the wall and leans on it with 12 N, but for now and then."""

WAVERING = (-0.5 * math.pi, *[Uniform(-math.pi, math.pi)] * (SINES - 1))
"""Phases of a hand that leans all the time and moves away now and then."""

CORRIDOR = replace(STANDARD, free_left=0.02, free_right=0.02)

WALL = replace(STANDARD, hand=LEANING, free_left=0.1)
"""The wall is to the right of the path."""

CURVED = replace(STANDARD, error_max=CURVED_WIDTH)

PACE = LogUniform(min(PACES.values()), max(PACES.values()))
"""The commanded pace of training episodes, unless one is given."""

SUITE_DRAWS = MappingProxyType(
    {
        "standard": Draws(task=Vary(STANDARD, pace=PACE)),
        "paths": Draws(task=Vary(CURVED, path=CURVES, pace=PACE)),
        "hands": Draws(task=Vary(STANDARD, hand=OneOf((FORCES, HUMANS)), pace=PACE)),
        "materials": Draws(
            machine=Vary(BASELINE, clutch=ANY_CLUTCHES, clutch_scale=TORQUE_ERRORS),
            task=Vary(STANDARD, friction_drift=FRICTION_DRIFT, pace=PACE),
        ),
        "everything": Draws(
            machine=Vary(BASELINE, arm=ARMS, clutch=ANY_CLUTCHES, clutch_scale=TORQUE_ERRORS),
            task=Vary(
                CURVED,
                path=CURVES,
                hand=OneOf((EQ5, FORCES, HUMANS)),
                friction_drift=FRICTION_DRIFT,
                sensing=SENSORS,
                pace=PACE,
            ),
        ),
        "tremor": Draws(task=Vary(STANDARD, hand=TREMBLING, pace=PACE)),
        "corridor": Draws(task=Vary(CORRIDOR, pace=PACE)),
        "wall": Draws(task=Vary(WALL, hand=Vary(LEANING, phases=WAVERING), pace=PACE)),
    }
)
"""Draws of the suite's scenarios by name."""
