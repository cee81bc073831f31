"""What a training run draws: a scenario's episodes, wider ones for ``ALL``, and validation ones.

The scenarios' paths mostly head along x, and their machines are near the paper's. A policy for all
scenarios also trains on paths of every heading, either direction and tight bends, and on machines
and hands beyond theirs.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from pter_agents.settings import MIXED_NAME, TrainingArguments
from pter_gym.benchmark import Episodes, evaluate
from pter_gym.controllers import AnyPolicy
from pter_gym.controllers._scaled import traits_of
from pter_gym.hands import HandSpread, Operator
from pter_gym.params import BASELINE, Machine, MachineSpread, TorqueCurve
from pter_gym.paths import Arc, Circle, Line, Sine
from pter_gym.policies._interface import Interval
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.scenarios.distributions import Draws, LogUniform, OneOf, Shared, Uniform, Vary
from pter_gym.scenarios.variations import (
    ANY_CLUTCHES,
    CURVED,
    CURVES,
    EQ5,
    FORCES,
    FRICTION_DRIFT,
    HUMANS,
    PACE,
    SENSORS,
)
from pter_gym.tasks.path_following import STARTS

VALIDATION_SEED = 2**31 + 1
"""Seed of the draws of validation episodes, larger than any seed of a run."""

FIRST_RESET = 2**50
"""Seed of the first validation episode's reset."""

VALIDATION_SCORES = (
    "path_error_m",
    "completed",
    "mean_pace_error",
    "segment_pace_error",
    "peak_acceleration_m_s2",
)
"""Those of a validation: what a rank needs, and the acceleration."""

PaceScores = Mapping[str, Mapping[str, float]]
"""Mean scores by pace."""

ANY_PACE = OneOf(
    tuple(pace for pace in PACES.values() for _ in range(round(pace / min(PACES.values()))))
)
"""The commanded paces [m/s], fast ones repeated for about the same share of time."""

MIXED = ("standard", "paths", "hands", "materials", "tremor", "everything")
"""The scenarios of ``ALL``; ``corridor`` and ``wall`` are not among them."""

MAX_VARIED = "everything"
"""The scenario that has as many of the draws of ``ALL`` as the others of ``MIXED`` together."""

REPEATS = {Circle: 6, Arc: 2}
"""How often training draws a kind of path for each path of another kind: rare headings."""

TIGHT = 0.08
"""Half-width of the workspace about tight bends [m]."""

ANY_DIRECTION = Uniform(-math.pi, math.pi)

X, Y = Uniform(-0.65, 0.65), Uniform(0.35, 0.85)
"""Where paths of every heading begin [m]."""

SHORTER: dict[Any, dict[str, Uniform]] = {
    Line: {"length": Uniform(0.25, 1.0)},
    Sine: {"extent": Uniform(0.5, 0.95)},
}
"""Lengths [m] with which more of the paths of every heading fit the workspace."""

FIT_SELDOM = (Line, Arc, Sine)
"""Kinds that are drawn three times as often, since many of their draws leave the workspace."""


def _turned(kind: Vary[Any]) -> Vary[Any]:
    """Return a kind of path that begins and heads anywhere, or that runs backwards."""
    if "points" in kind.fields:
        return Vary(kind.template, **{**kind.fields, "points": kind.fields["points"][::-1]})
    if isinstance(kind.template, Circle):
        return kind
    shorter = SHORTER.get(kind.template.__class__, {})
    return Vary(
        kind.template, **{**kind.fields, **shorter, "x": X, "y": Y, "direction": ANY_DIRECTION}
    )


TURNED = OneOf(
    tuple(
        _turned(kind)
        for kind in CURVES.options
        for _ in range(3 if isinstance(kind.template, FIT_SELDOM) else 1)
    )
)
"""Lines, arcs and sines of every heading, circles, and splines and corners from right to left."""

BENDS = OneOf(
    (
        Vary(
            Arc(),
            x=X,
            y=Y,
            direction=ANY_DIRECTION,
            radius=LogUniform(0.09, 0.2),
            angle=OneOf((Uniform(-5.0, -2.0), Uniform(2.0, 5.0))),
        ),
        Vary(
            Circle(),
            center_x=Uniform(-0.25, 0.25),
            center_y=Uniform(0.5, 0.7),
            radius=LogUniform(0.09, 0.15),
            start=ANY_DIRECTION,
            clockwise=OneOf((False, True)),
        ),
    )
)
"""Tight arcs and circles."""

EDGES = OneOf(
    (
        Vary(
            Arc(),
            x=Uniform(-0.5, -0.1),
            y=Uniform(0.55, 0.7),
            direction=Uniform(0.0, 0.9),
            radius=Uniform(0.2, 0.5),
            angle=Uniform(1.0, 1.9),
        ),
        Vary(
            Arc(),
            x=Uniform(-0.5, -0.1),
            y=Uniform(0.4, 0.66),
            direction=Uniform(-0.5, 0.3),
            radius=Uniform(0.2, 0.55),
            angle=Uniform(-2.0, -1.2),
        ),
    )
)
"""Arcs that turn left far out, and arcs that turn right near the base, where clutches stick."""

WIDER = (
    Draws(task=Vary(CURVED, path=TURNED, hand=OneOf((EQ5, FORCES)), pace=PACE), weight=6),
    Draws(task=Vary(replace(CURVED, error_max=TIGHT), path=BENDS, hand=EQ5, pace=PACE), weight=2),
    Draws(task=Vary(CURVED, path=EDGES, hand=OneOf((EQ5, FORCES)), pace=PACE), weight=2),
    Draws(
        machine=Vary(
            BASELINE,
            arm=Vary(BASELINE.arm, inertia_a=Uniform(0.36, 0.75), inertia_b=Uniform(0.8, 1.75)),
            clutch=OneOf(
                tuple(
                    Vary(kind.template, time_constant=LogUniform(0.03, 0.35))
                    for kind in ANY_CLUTCHES.options
                )
            ),
            clutch_scale=Shared(LogUniform(0.5, 1.5), LogUniform(0.9, 1.11), 4),
        ),
        task=Vary(
            CURVED,
            path=OneOf((Line(), TURNED)),
            hand=OneOf(
                (
                    EQ5,
                    Vary(FORCES.template, **{**FORCES.fields, "push": Uniform(45.0, 100.0)}),
                    HUMANS,
                )
            ),
            friction_drift=FRICTION_DRIFT,
            sensing=SENSORS,
            pace=PACE,
        ),
        weight=5,
    ),
)
"""What ``ALL`` draws beside the scenarios."""


class Devices:
    """Devices of PTER's kind, drawn at random; a ratio's logarithm is uniform.

    Torques are 0.3 to 3 times PTER's, each within 10 % of a common one, and linear in the voltage
    or as PTER's; up to a tenth of it acts without voltage, in every other device. Breakaway torques
    are 1 to 1.5 times as large, time constants 5 ms to 0.3 s. Every other device has hysteresis, of
    up to ±8 % of the largest voltage. Links are 0.6 to 1.5 times as long, each within 10 %, and 0.6
    to 2 times as heavy as these would be. Two in five have the paper's four clutches, one in five
    lacks the first; of the others, each lacks another one, or both couplings.
    """

    middle = BASELINE
    """The machine that a law knows which is the same for all devices."""

    torque, lag, length, weight = (
        LogUniform(*ends) for ends in ((0.3, 3.0), (0.005, 0.3), (0.6, 1.5), (0.6, 2.0))
    )
    breakaway, off_state = Uniform(1.0, 1.5), Uniform(-0.1, 0.1)
    hysteresis = Uniform(-0.08, 0.08)
    each = LogUniform(0.9, 1.11)
    there = OneOf(
        (
            *[(1.0, 1.0, 1.0, 1.0)] * 4,
            *[(0.0, 1.0, 1.0, 1.0)] * 2,
            (1.0, 0.0, 1.0, 1.0),
            (1.0, 1.0, 0.0, 1.0),
            (1.0, 1.0, 1.0, 0.0),
            (1.0, 1.0, 0.0, 0.0),
        )
    )

    def draw(self, rng: np.random.Generator) -> Machine:
        """Return a device."""
        arm, clutch = BASELINE.arm, BASELINE.clutch
        top, curve = clutch.voltage_max, clutch.dynamic
        usual = curve.torque(top)
        torque = usual * self.torque.draw(rng)
        off = torque * max(0.0, self.off_state.draw(rng))
        hysteresis = top * max(0.0, self.hysteresis.draw(rng))
        full = top - hysteresis
        linear = TorqueCurve(slope=(torque - off) / full, knee=top, curvature=0.0, off_state=off)
        bent = replace(curve.scaled((torque - off) / curve.torque(full)), off_state=off)
        dynamic = (linear, bent)[int(rng.integers(2))]
        there = cast("tuple[float, ...]", self.there.draw(rng))
        size, weight = self.length.draw(rng), self.weight.draw(rng)
        heavier = weight * size**2
        return replace(
            BASELINE,
            arm=replace(
                arm,
                length_a=arm.length_a * size * self.each.draw(rng),
                length_b=arm.length_b * size * self.each.draw(rng),
                inertia_a=arm.inertia_a * heavier,
                inertia_b=arm.inertia_b * heavier,
                coupling=arm.coupling * heavier,
            ),
            clutch=replace(
                clutch,
                dynamic=dynamic,
                breakaway=dynamic.scaled(self.breakaway.draw(rng)),
                time_constant=self.lag.draw(rng),
                hysteresis=hysteresis,
            ),
            clutch_scale=tuple(scale * self.each.draw(rng) for scale in there),
        )

    @property
    def trained(self) -> tuple[Interval, ...]:
        """What the traits of the devices are between."""
        least, most = self.each.low, self.each.high
        ratios = {
            "torque": (self.torque.low * least, self.torque.high * most),
            "mass": (self.weight.low / most**2, self.weight.high / least**2),
            "size": (self.length.low * least, self.length.high * most),
        }
        usual = traits_of(BASELINE)
        ends = {
            name: tuple(ratio * getattr(usual, name) for ratio in pair)
            for name, pair in ratios.items()
        }
        ends |= {
            "lag": (self.lag.low, self.lag.high),
            "breakaway": (self.breakaway.low, self.breakaway.high),
            "brakes": (1.0, 2.0),
            "hysteresis": (0.0, self.hysteresis.high),
        }
        return tuple(Interval(name, low, high) for name, (low, high) in ends.items())

    def extremes(self) -> tuple[Machine, ...]:
        """Return two devices, which differ."""
        return tuple(self.draw(np.random.default_rng(seed)) for seed in range(2))


DEVICES = Devices()


def draws_for(
    scenario: str,
    pace: str,
    machine: Machine | MachineSpread | None = None,
    hand: Operator | HandSpread | None = None,
    **fields: object,
) -> Draws:
    """Return the draws of a scenario at a pace.

    Parameters
    ----------
    scenario
        Its name, or ``"all"`` for those in ``MIXED`` and what is ``WIDER``.
    pace
        Name of a commanded pace, or ``"all"``.
    machine
        A machine, or machines about one, in place of those that the scenarios draw.
    hand
        A hand, or hands about one, in place of those that the scenarios draw.
    **fields
        Fields of the task that all episodes share, such as ``reward``, ``starts`` and
        ``truncation_error``.

    Raises
    ------
    ParameterError
        If there is no such scenario or pace; the message suggests the nearest.
    """
    if scenario == MIXED_NAME:
        suite = {name: find_scenario(name, machine, hand=hand).draws for name in MIXED}
        suite[MAX_VARIED] = replace(suite[MAX_VARIED], weight=len(MIXED) - 1)
        first, *more = suite.values()
        others = WIDER if hand is None else [find_scenario(x, hand=hand).draws for x in WIDER]
        wider = (replace(draws, instead=machine) for draws in others)
        draws = replace(first, also=(*more, *wider))
    else:
        draws = find_scenario(scenario, machine, hand=hand).draws
    return draws.at_pace(ANY_PACE if pace == MIXED_NAME else pace).with_task(**fields)


def training_draws(arguments: TrainingArguments) -> Draws:
    """Return the draws of a training: its scenario's, with kinds of paths as in ``REPEATS``."""
    s = arguments.settings
    draws = draws_for(
        arguments.scenario,
        arguments.pace,
        arguments.machine,
        arguments.hand,
        reward=s.reward(),
        starts=STARTS[s.starts],
        truncation_error=s.truncation,
    ).map_components(_with_repeats)
    if s.devices:
        draws = draws.map_components(lambda each: replace(each, instead=DEVICES))
    return draws


def _with_repeats(draws: Draws) -> Draws:
    """Return draws with each kind of path as often as ``REPEATS`` says."""
    task = draws.varied_task
    if "path" not in task.fields:
        return draws
    repeated = tuple(
        kind
        for kind in task.fields["path"].options
        for _ in range(REPEATS.get(getattr(kind, "template", kind).__class__, 1))
    )
    return replace(draws, task=Vary(task.template, **{**task.fields, "path": OneOf(repeated)}))


def validation_episodes(arguments: TrainingArguments) -> dict[str, Episodes]:
    """Return held-out training episodes by pace: test episodes stay unseen."""
    found: dict[str, Episodes] = {}
    for pace in arguments.paces:
        draws = draws_for(arguments.scenario, pace, arguments.machine, arguments.hand)
        pairs = draws.pairs(arguments.validation_episodes, VALIDATION_SEED)
        seeds = range(FIRST_RESET, FIRST_RESET + len(pairs))
        found[pace] = Episodes.from_pairs(arguments.scenario, draws, pairs, seeds)
    return found


def validate(policy: AnyPolicy, episodes: Mapping[str, Episodes]) -> PaceScores:
    """Return the mean scores of a policy for each pace."""
    scores = {pace: evaluate(policy, at_pace) for pace, at_pace in episodes.items()}
    return {
        pace: {name: float(found[name].mean()) for name in VALIDATION_SCORES}
        for pace, found in scores.items()
    }
