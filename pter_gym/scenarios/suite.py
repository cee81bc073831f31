"""The suite: named and versioned scenarios, each a randomisation of machine and task at a commanded pace.

``PTER/<Scenario>-v0`` is ``PTER/PathFollowing-v0`` on a scenario's training draws. The episodes on which policies are
compared are stored data; see ``pter_gym.benchmark``.
"""

import math
from dataclasses import dataclass, replace
from types import MappingProxyType

from pter_gym.errors import unknown_name
from pter_gym.hands import EQ5_FREQUENCIES, NORMAL, RELAXED, SINES, TENSE, HumanArm, MultiSineHand
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Machine
from pter_gym.paths import Arc, Circle, Line, Polyline, Sine, Spline
from pter_gym.scenarios.randomisation import LogUniform, OneOf, Randomisation, Repeat, Shared, Tuple, Uniform, Vary
from pter_gym.tasks.path_following import PathFollowing, Sensing

PACES = MappingProxyType({"slow": 0.12, "medium": 0.25, "brisk": 0.5})
"""Commanded mean speeds along the path [m/s] at which each scenario is scored."""

WIDTH = 0.1
"""Half-width of the workspace about curved paths [m]: nine tenths of their smallest radius of curvature at most."""

TIGHTEST = 0.13
"""Smallest radius of a drawn arc or rounded corner [m]."""


@dataclass(frozen=True)
class Scenario:
    """A named set of episodes.

    Attributes
    ----------
    name, version
        As in the id ``PTER/<Name>-v<version>``.
    asks
        What it asks of a policy, in a sentence.
    machine, task
        What varies; the task's pace is set when a scenario is run or made into an environment.
    """

    name: str
    version: int
    asks: str
    machine: Machine | Vary[Machine]
    task: PathFollowing | Vary[PathFollowing]

    @property
    def id(self) -> str:
        """The id of the environment."""
        return f"PTER/{self.name.capitalize()}-v{self.version}"

    def randomisation(self, pace: float | str | None = None, *, contexts: int = 512, seed: int = 0) -> Randomisation:
        """Return the training draws.

        Parameters
        ----------
        pace
            Commanded pace [m/s] or its name in ``PACES``; None draws it between the slowest and the fastest of them.
        contexts, seed
            Number of pairs of machine and task, and the seed of their list.
        """
        speeds = PACES.values()
        commanded = LogUniform(min(speeds), max(speeds)) if pace is None else OneOf((find_pace(pace),))
        fields = self.task.fields if isinstance(self.task, Vary) else {}
        base = self.task.base if isinstance(self.task, Vary) else self.task
        return Randomisation(
            machine=self.machine, task=Vary(base, **fields, pace=commanded), contexts=contexts, seed=seed
        )


def find_pace(pace: float | str) -> float:
    """Return a commanded pace [m/s] given as itself or by its name in ``PACES``.

    Raises
    ------
    ParameterError
        If there is no such name; it tells the nearest.
    """
    if not isinstance(pace, str):
        return pace
    if pace not in PACES:
        raise unknown_name("pace", pace, PACES)
    return PACES[pace]


def find_scenario(name: str) -> Scenario:
    """Return a scenario by its name.

    Raises
    ------
    ParameterError
        If there is no such scenario; it tells the nearest.
    """
    if name not in SCENARIOS:
        raise unknown_name("scenario", name, SCENARIOS)
    return SCENARIOS[name]


EQ5 = MultiSineHand(random_phases=True)
"""The paper's hand with phases drawn at each reset."""

FORCES = Vary(
    EQ5,
    push=Uniform(45.0, 75.0),
    amplitudes=Repeat(Uniform(2.0, 7.0), SINES),
    frequencies=Repeat(LogUniform(min(EQ5_FREQUENCIES), max(EQ5_FREQUENCIES)), SINES),
)
"""A push along the path, and five sines across it of any amplitude, frequency and phase."""

HUMANS = OneOf(
    tuple(
        Vary(
            HumanArm(impedance=impedance, random_phases=True),
            eagerness=Uniform(1.3, 1.7),
            rise=Uniform(0.2, 0.5),
            amplitudes=Repeat(Uniform(1.0, 5.0), SINES),
        )
        for impedance in (RELAXED, NORMAL, TENSE)
    )
)
"""A relaxed, normal or tense human arm."""


def _points(*boxes: tuple[float, float, float, float]) -> Tuple:
    """Return waypoints drawn from boxes (x from, x to, y from, y to) [m]."""
    return Tuple(tuple(Tuple((Uniform(x0, x1), Uniform(y0, y1))) for x0, x1, y0, y1 in boxes))


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
            radius=Uniform(TIGHTEST, 0.2),
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
                (-0.6, -0.45, 0.55, 0.75), (-0.3, -0.1, 0.5, 0.75), (0.1, 0.3, 0.5, 0.75), (0.45, 0.6, 0.55, 0.75)
            ),
        ),
        Vary(
            Polyline(points=((-0.5, 0.6), (0.0, 0.7), (0.5, 0.6)), radius=TIGHTEST),
            points=_points((-0.55, -0.45, 0.5, 0.7), (-0.1, 0.1, 0.6, 0.8), (0.4, 0.55, 0.5, 0.7)),
            radius=Uniform(TIGHTEST, 0.25),
        ),
    )
)
"""Lines, arcs, circles, sines, splines through four waypoints and rounded corners, all across the workspace."""

CLUTCHES = OneOf(
    tuple(
        Vary(machine.clutch, time_constant=LogUniform(0.03, 0.2))
        for machine in (BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL)
    )
)
"""The three clutch materials of the paper, with any time constant of those that it simulates from 30 ms on."""

TORQUE_ERRORS = Shared(LogUniform(0.75, 1.33), LogUniform(0.9, 1.11), 4)
"""Clutch torques over those of the curves: temperature and humidity for all, and each clutch's own."""

DRIFT = Uniform(-0.015, 0.015)
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

_LISTED = (
    Scenario(
        name="standard",
        version=0,
        asks="The paper's line, hand and clutches; the phases of the disturbance differ.",
        machine=BASELINE,
        task=STANDARD,
    ),
    Scenario(
        name="paths",
        version=0,
        asks="Other paths, most of them curved; the paper's hand and clutches.",
        machine=BASELINE,
        task=Vary(replace(STANDARD, error_max=WIDTH), path=CURVES),
    ),
    Scenario(
        name="hands",
        version=0,
        asks="Other hands on the paper's line: forces of any spectrum, and human arms with mass, damper and spring.",
        machine=BASELINE,
        task=Vary(STANDARD, hand=OneOf((FORCES, HUMANS))),
    ),
    Scenario(
        name="materials",
        version=0,
        asks="Other clutches on the paper's line: material, time constant, torque errors and drift.",
        machine=Vary(BASELINE, clutch=CLUTCHES, clutch_scale=TORQUE_ERRORS),
        task=Vary(STANDARD, friction_drift=DRIFT),
    ),
    Scenario(
        name="everything",
        version=0,
        asks="Paths, hands and clutches as in the other scenarios, other inertias, and sensors with noise and delay.",
        machine=Vary(BASELINE, arm=ARMS, clutch=CLUTCHES, clutch_scale=TORQUE_ERRORS),
        task=Vary(
            replace(STANDARD, error_max=WIDTH),
            path=CURVES,
            hand=OneOf((EQ5, FORCES, HUMANS)),
            friction_drift=DRIFT,
            sensing=SENSORS,
        ),
    ),
)

SCENARIOS = MappingProxyType({scenario.name: scenario for scenario in _LISTED})
"""The scenarios by name."""
