"""Find plausible values for what the paper does not print, from its Table I and its trends: a calibration.

Every candidate obeys the rules of the search space by construction; what cannot be built in costs a penalty. The trends
of Figs. 7, 8 and 10 have weights of their own: with a weight they are fitted, and their holding is no evidence.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from pter_gym.benchmark.measures import column, low_pass, vector
from pter_gym.benchmark.recorded import START_UP
from pter_gym.benchmark.standard import TIME_CONSTANTS, Run
from pter_gym.compiled.compiler import device
from pter_gym.controllers import TorqueFeedback
from pter_gym.controllers.laws import IMPEDANCE, guide
from pter_gym.engine.batch import Batch
from pter_gym.engine.law import MEMORY
from pter_gym.errors import ParameterError
from pter_gym.hands import eq5
from pter_gym.internal.files import write_text_atomic
from pter_gym.internal.terminal import progress_bar
from pter_gym.paper.experiments.feedback import BEST_GAIN
from pter_gym.paper.experiments.measures import PLATEAU_FROM, SATURATED, rank_correlation
from pter_gym.paper.experiments.setup import ErrorAverage, Setup
from pter_gym.paper.experiments.time_constants import PAPER_TABLE, standard_runs
from pter_gym.paper.experiments.time_constants import TIME_CONSTANTS as SWEPT
from pter_gym.params import (
    BREAKAWAY_SMALL_VOLTAGE,
    MU_DYNAMIC_DELRIN,
    MU_STATIC_DELRIN,
    MU_STATIC_PRESENT,
    TIME_CONSTANT,
    Arm,
    Clutch,
    Lag,
    Machine,
    TorqueCurve,
    with_friction,
)
from pter_gym.params.preset import (
    ArmValues,
    ClutchValues,
    ControllerValues,
    DelrinValues,
    HandValues,
    PathValues,
    Preset,
    format_preset,
)
from pter_gym.paths import Line
from pter_gym.physics.clutch import PerClutch
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.units import INCH, INCH_POUND

Array = NDArray[np.float64]

TARGET = np.array(list(PAPER_TABLE.values()))
"""The paper's Table I, (3 machines, 3 columns), in inches, in/s and in/s²."""


@dataclass(frozen=True)
class Free:
    """One searched number: its range and the reason for it."""

    name: str
    unit: str
    low: float
    high: float
    reason: str
    logarithmic: bool = False


SPACE: tuple[Free, ...] = (
    Free("length_a", "m", 0.3, 0.66, "PTER's links were of the order of half a metre"),
    Free("length_b", "m", 0.3, 0.66, "PTER's links were of the order of half a metre"),
    Free("inertia_a", "kg·m²", 0.25, 2.0, "aluminium links, with clutch rotors and gears", True),
    Free("inertia_b", "kg·m²", 0.25, 2.0, "aluminium links, with clutch rotors and gears", True),
    Free("coupling", "1", -0.6, 0.6, "relative to √(M11·M22): the mass matrix stays well conditioned"),
    Free("small_voltage", "V", 4.0, 8.0, "where breakaway is 63.5 in·lbf: a small voltage, not below the tests"),
    Free("knee", "V", 8.0, 22.0, "the linear segment holds the small voltages"),
    Free("top_torque", "N·m", 15.0, 70.0, "dynamic torque at 24 V of clutches of this kind"),
    Free("breakaway_ratio", "1", 1.12, 1.5, "T_s/T_k: Fig. 9 shows a clear jump"),
    Free("delrin_ratio", "1", 1.12, 1.24, "T_s/T_k: Fig. 9 shows a jump similar to the present clutches'"),
    Free("delrin_scale", "1", 0.5, 0.95, "experimental Delrin has less friction than the present clutches"),
    Free("path_height", "1", 0.0, 0.8, "between the inner and the outer limit of reach, |sin(θA − θB)| ≥ 0.4"),
    Free("path_length", "m", 0.4, 1.2, "across the workspace of such an arm"),
    Free("path_offset", "1", -1.0, 1.0, "of the path's centre, within the reach"),
    Free("push", "N", 20.0, 90.0, "what an arm does with ease"),
    Free("disturbance", "1", 0.2, 1.0, "of what leaves the whole hand force below 98 N"),
    Free("stiffness", "N/m", 100.0, 3000.0, "from soft guidance to a stiff wall", True),
    Free("damping_ratio", "1", 0.3, 8.0, "of spring and normal damper on the tip's mass, at most m/10 ms", True),
    Free("damping_tangential", "N·s/m", 10.0, 400.0, "at most m/10 ms: half of what a sampled damper may have", True),
    Free("slip_threshold", "rad/s", 0.001, 0.1, "what a controller can tell from rest", True),
)
"""The search space."""

HAND_MAX = 98.0
"""Largest force of the hand [N]: about 10 kgf."""

ELBOW_COS = math.sqrt(1.0 - 0.4**2)

TABLE_VOLTS = (0.0, 4.0, 10.0, 17.0, 24.0)

DIGITS = 4
"""Significant digits of a candidate: what is written is what was evaluated."""

DelrinRule = Literal["coefficients", "static"]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Where the paper is ambiguous: one choice of each.

    Attributes
    ----------
    error_average
        Average |error| over time or over the path.
    control_period
        Of the controller [s].
    filtered
        Whether accelerations pass the first-order low-pass.
    start_up
        Time at the start that accelerations leave out [s].
    delrin_rule
        Theoretical Delrin scales T_k by its μk over the present clutches' μk (``"coefficients"``), or over their μs,
        the only one that is printed (``"static"``).
    own_table
        Whether a Delrin machine's controller has that machine's torque table.
    tip_space
        Whether torques are allocated for tip force rather than joint torque.
    lag
        What lags behind the voltage.
    """

    error_average: ErrorAverage = "time"
    control_period: float = 0.01
    filtered: bool = True
    start_up: float = START_UP
    delrin_rule: DelrinRule = "coefficients"
    own_table: bool = False
    tip_space: bool = False
    lag: Lag = "normal_force"


READINGS: dict[str, Reading] = {
    "as calibrated": Reading(),
    "error averaged over the path": Reading(error_average="path"),
    "control every 5 ms": Reading(control_period=0.005),
    "acceleration not filtered": Reading(filtered=False),
    "acceleration with the start-up": Reading(start_up=0.0),
    "theoretical Delrin: T_k by 0.35/0.45": Reading(delrin_rule="static"),
    "Delrin with its own torque table": Reading(own_table=True),
    "allocation in tip space": Reading(tip_space=True),
    "lag of the voltage": Reading(lag="voltage"),
}
"""The named options, each with one choice changed."""


def rounded(value: float) -> float:
    """Return a number with ``DIGITS`` significant digits."""
    return float(f"{value:.{DIGITS}g}")


def curve_of(values: dict[str, float]) -> TorqueCurve:
    """Return the dynamic curve: 63.5 in·lbf of breakaway at the small voltage, monotone, and the top torque at 24 V."""
    slope = BREAKAWAY_SMALL_VOLTAGE / (values["breakaway_ratio"] * values["small_voltage"])
    top, knee = TABLE_VOLTS[-1], values["knee"]
    least = 1.05 * (slope * top - 0.5 * slope * (top - knee))
    curvature = (max(values["top_torque"], least) - slope * top) / (top - knee) ** 2
    return TorqueCurve(slope=rounded(slope), knee=rounded(knee), curvature=rounded(curvature))


def line_of(values: dict[str, float]) -> Line:
    """Return a path that the arm reaches with |sin(θA − θB)| ≥ 0.4."""
    a, b = values["length_a"], values["length_b"]
    near, far = (math.sqrt(a * a + b * b + sign * 2.0 * ELBOW_COS * a * b) for sign in (-1.0, 1.0))
    y = near + values["path_height"] * (far - near)
    chord = 2.0 * math.sqrt(far * far - y * y)
    length = min(values["path_length"], 0.98 * chord)
    x = -0.5 * length + values["path_offset"] * 0.5 * (chord - length)
    return Line(x=rounded(x), y=rounded(y), direction=0.0, length=rounded(length))


def tip_masses(arm: Arm, line: Line) -> tuple[float, float]:
    """Return the effective masses of the tip along and across the path at its middle [kg]."""
    x, y = line.point(0.5 * line.length)
    a, b = arm.length_a, arm.length_b
    cos = (x * x + y * y - a * a - b * b) / (2.0 * a * b)
    theta_a = math.atan2(y, x) - math.atan2(b * math.sqrt(1.0 - cos * cos), a + b * cos)
    theta_b = theta_a + math.acos(cos)
    jacobian = np.array(
        [[-a * math.sin(theta_a), -b * math.sin(theta_b)], [a * math.cos(theta_a), b * math.cos(theta_b)]]
    )
    m12 = arm.coupling * cos
    mobility = jacobian @ np.linalg.inv([[arm.inertia_a, m12], [m12, arm.inertia_b]]) @ jacobian.T
    return 1.0 / float(mobility[0, 0]), 1.0 / float(mobility[1, 1])


EQ5_PEAK = 0.6173
"""Largest |Fn|/Fmax of Eq. 5."""


def decode(point: Array) -> Preset:
    """Return the preset at a point of the unit cube, shape (len(SPACE),). Every point gives an admissible one."""
    values = {
        free.name: free.low * (free.high / free.low) ** u if free.logarithmic else free.low + u * (free.high - free.low)
        for free, u in zip(SPACE, np.clip(point, 0.0, 1.0).tolist(), strict=True)
    }
    values["length_a"], values["length_b"] = rounded(values["length_a"]), rounded(values["length_b"])
    arm = Arm(
        length_a=values["length_a"],
        length_b=values["length_b"],
        inertia_a=rounded(values["inertia_a"]),
        inertia_b=rounded(values["inertia_b"]),
        coupling=rounded(values["coupling"] * math.sqrt(values["inertia_a"] * values["inertia_b"])),
    )
    curve, line = curve_of(values), line_of(values)
    along, across = tip_masses(arm, line)
    room = min(math.sqrt(HAND_MAX**2 - values["push"] ** 2) / EQ5_PEAK, HAND_MAX)
    damping = min(2.0 * values["damping_ratio"] * math.sqrt(values["stiffness"] * across), across / 0.01)
    return Preset(
        arm=ArmValues(**{name: getattr(arm, name) for name in ArmValues.__dataclass_fields__}),
        clutch=ClutchValues(
            slope=curve.slope,
            knee=curve.knee,
            curvature=curve.curvature,
            breakaway_ratio=rounded(values["breakaway_ratio"]),
            time_constant=TIME_CONSTANT,
            voltage_max=TABLE_VOLTS[-1],
        ),
        delrin=DelrinValues(
            dynamic_scale=rounded(values["delrin_scale"]), breakaway_ratio=rounded(values["delrin_ratio"])
        ),
        path=PathValues(x=line.x, y=line.y, direction=line.direction, length=line.length),
        hand=HandValues(push=rounded(values["push"]), force_max=rounded(values["disturbance"] * room)),
        controller=ControllerValues(
            stiffness=rounded(values["stiffness"]),
            damping_normal=rounded(damping),
            damping_tangential=rounded(min(values["damping_tangential"], along / 0.01)),
            slip_threshold=rounded(values["slip_threshold"]),
            table_volts=TABLE_VOLTS,
            feedback=BEST_GAIN / INCH_POUND,
        ),
        provenance=PROVENANCE,
    )


_LINKS = "fitted: PTER's links were of the order of half a metre"
_INERTIA = "fitted: a link with clutch rotors and gears"
_CURVE = "fitted: breakaway is 63.5 in·lbf (published) between 4 and 8 V"

PROVENANCE: dict[str, str] = {
    "arm.length_a": _LINKS,
    "arm.length_b": _LINKS,
    "arm.inertia_a": _INERTIA,
    "arm.inertia_b": _INERTIA,
    "arm.coupling": "fitted: between the axes",
    "clutch.slope": _CURVE,
    "clutch.knee": "fitted: where the quadratic segment begins",
    "clutch.curvature": "fitted: quadratic segment",
    "clutch.breakaway_ratio": "fitted: T_s/T_k, at least 1.12 for the jump of Fig. 9",
    "clutch.time_constant": "published: section IV-C.3",
    "clutch.voltage_max": "chosen: a common supply for such clutches",
    "delrin.dynamic_scale": "fitted: T_k relative to the present clutches",
    "delrin.breakaway_ratio": "fitted: T_s/T_k, at least 1.12 for the jump of Fig. 9",
    "path.x": "fitted: across the workspace",
    "path.y": "fitted: across the workspace",
    "path.direction": "chosen: along the x axis",
    "path.length": "fitted: across the workspace",
    "hand.push": "fitted: the constant tangential force of section IV-A",
    "hand.force_max": "fitted: Fmax of Eq. 5",
    "controller.stiffness": "fitted: spring normal to the path",
    "controller.damping_normal": "fitted: damper normal to the path",
    "controller.damping_tangential": "fitted: damper along the path",
    "controller.slip_threshold": "fitted: a slower clutch counts as stuck",
    "controller.table_volts": "chosen: five knots; 4 V published",
    "controller.feedback": "published: Kp = 0.06 (section IV-C.3), read as V per in·lbf",
}


def setup_of(preset: Preset, reading: Reading | None = None) -> Setup:
    """Return the machines, the task and the controller of a preset under a reading of the paper."""
    reading = Reading() if reading is None else reading
    arm = Arm(**{name: getattr(preset.arm, name) for name in ArmValues.__dataclass_fields__})
    dynamic = TorqueCurve(slope=preset.clutch.slope, knee=preset.clutch.knee, curvature=preset.clutch.curvature)
    ratio = preset.clutch.breakaway_ratio
    present = Clutch(
        breakaway=dynamic.scaled(ratio),
        dynamic=dynamic,
        time_constant=preset.clutch.time_constant,
        voltage_max=preset.clutch.voltage_max,
        lag=reading.lag,
    )
    mu_dynamic = MU_STATIC_PRESENT / ratio if reading.delrin_rule == "coefficients" else MU_STATIC_PRESENT
    scale = preset.delrin.dynamic_scale
    clutches = (
        present,
        with_friction(present, scale * preset.delrin.breakaway_ratio / ratio, scale),
        with_friction(present, MU_STATIC_DELRIN / MU_STATIC_PRESENT, MU_DYNAMIC_DELRIN / mu_dynamic),
    )
    return Setup(
        machines={name: Machine(arm=arm, clutch=clutch) for name, clutch in zip(PAPER_TABLE, clutches, strict=True)},
        task=PathFollowing(
            path=Line(**{name: getattr(preset.path, name) for name in PathValues.__dataclass_fields__}),
            hand=eq5(preset.hand.force_max, preset.hand.push),
            control_period=reading.control_period,
        ),
        controller=TorqueFeedback(
            tip_space=reading.tip_space,
            **{name: getattr(preset.controller, name) for name in ControllerValues.__dataclass_fields__},
        ),
        own_table=reading.own_table,
        error_average=reading.error_average,
    )


def table_of(preset: Preset, reading: Reading | None = None, substep: float = 1e-3) -> Array:
    """Return Table I in inches, in/s and in/s², shape (3, 3), of a preset under a reading."""
    reading = Reading() if reading is None else reading
    setup = setup_of(preset, reading)
    rows: list[Array] = []
    for machine in setup.machines.values():
        runs = standard_runs(setup, replace(machine, substep=substep), 0.0, TIME_CONSTANTS)
        rows.append(np.mean([_entries(run, setup, reading) for run in runs], axis=0))
    return np.array(rows)


def _entries(run: Run, setup: Setup, reading: Reading) -> Array:
    """Return error, mean speed and mean acceleration of a run in the paper's units, (3,)."""
    acceleration = vector(run.telemetry, "acceleration")[1:]
    if reading.filtered:
        acceleration = low_pass(acceleration, reading.control_period)
    settled = np.linalg.norm(acceleration, axis=1)[column(run.telemetry, "time")[1:] > reading.start_up]
    return np.array([setup.position_error(run.score), run.score.mean_speed_m_s, settled.mean()]) / INCH


# --- many candidates at once ---


@device
def own_impedance(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of the impedance law with gains of each world's own, (kind, count, gains of world 0, …)."""
    count = int(gains[1])
    first = 2 + int(memory[MEMORY.world]) * count
    return guide(obs, scales, gains[first : first + count], memory)


@dataclass(frozen=True)
class Case:
    """One run to be made: a machine, its task, and the controller's gain of the torque loop [V/(N·m)]."""

    machine: Machine
    setup: Setup
    feedback: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """What came out of runs, arrays of shape (N,), in the paper's units."""

    error: Array
    speed: Array
    acceleration: Array
    peak: Array
    path_length: Array
    saturated: Array
    completed: NDArray[np.bool_]
    integrator: Array


STEPS = 250
"""Control steps within which a run must be complete."""


def run_cases(cases: Sequence[Case]) -> Outcome:
    """Run the standard test in many worlds at once."""
    batch = Batch([case.machine for case in cases], [case.setup.task for case in cases])
    gains = np.array(
        [case.setup.with_gain(case.feedback).bind(case.setup.baseline, batch.layout).gains for case in cases]
    )
    obs, first = batch.reset([0] * len(cases))
    flat = np.concatenate([[IMPEDANCE, gains.shape[1]], gains.ravel()])
    _, rows = batch.rollout(obs, own_impedance, flat, STEPS)
    alive = np.isfinite(rows[..., COLUMN.time])
    steps = np.maximum(alive.sum(axis=0), 1)
    rows = np.where(alive[..., None], rows, 0.0)
    period = cases[0].setup.task.control_period
    skipped = round(START_UP / period)
    filtered = np.linalg.norm(low_pass(vector(rows, "acceleration"), period), axis=-1) * alive
    tips = np.concatenate([vector(first, "tip")[None], vector(rows, "tip")])
    ways = np.linalg.norm(np.diff(tips, axis=0), axis=-1) * alive
    top = cases[0].machine.clutch.voltage_max * (1.0 - 1e-6)
    work = np.maximum(column(rows, "hand_work").sum(axis=0), 1e-9)
    return Outcome(
        error=np.abs(column(rows, "normal_error")).sum(axis=0) / steps / INCH,
        speed=np.linalg.norm(vector(rows, "tip_velocity"), axis=-1).sum(axis=0) / steps / INCH,
        acceleration=filtered[skipped:].sum(axis=0) / np.maximum(steps - skipped, 1) / INCH,
        peak=filtered[skipped:].max(axis=0) / INCH,
        path_length=ways.sum(axis=0) / INCH,
        saturated=(rows[..., [*COLUMN.volts]] >= top).mean(axis=-1).sum(axis=0) / steps,
        completed=rows[..., COLUMN.is_success].max(axis=0) > 0.0,
        integrator=np.abs((column(rows, "numerical_loss") - column(rows, "residual")).sum(axis=0)) / work,
    )


def at(machine: Machine, time_constant: float, substep: float = 1e-3) -> Machine:
    """Return a machine with another time constant and substep [s]."""
    return replace(machine, clutch=replace(machine.clutch, time_constant=time_constant), substep=substep)


GAINS = (0.0, 0.015, 0.03, 0.045, 0.06, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25)
"""Gains at which the search looks at Fig. 10 [V/(in·lbf)]."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the penalties beside Table I; 0 keeps what it weighs out of the search."""

    worst: float = 0.3
    refinement: float = 0.3
    trends: float = 0.3
    feedback: float = 0.15


TABLE_ONLY = Weights(trends=0.0, feedback=0.0)
"""Table I alone: the trends stay held out."""


def misfit(presets: Sequence[Preset], weights: Weights | None = None) -> Array:
    """Return the objective of presets, shape (K,): smaller is better, 0 is perfect.

    The root mean square of the logarithmic deviations from Table I, plus the part of the worst one beyond 4.5%, plus
    the fraction of runs that do not complete, plus the penalties. These are only looked at below 0.5.
    """
    weights = Weights() if weights is None else weights
    setups = [setup_of(preset) for preset in presets]
    tables, outcome = _tables(setups, 1e-3)
    deviation = np.abs(np.log(tables / TARGET))
    total = np.sqrt((deviation**2).mean(axis=(1, 2)))
    total += weights.worst * np.maximum(0.0, deviation.max(axis=(1, 2)) - 0.045)
    total += (~outcome.completed).reshape(len(setups), -1).mean(axis=1)
    integrator = outcome.integrator.reshape(len(setups), len(PAPER_TABLE), -1)[..., TIME_CONSTANTS.index(TIME_CONSTANT)]
    total += np.maximum(0.0, integrator.max(axis=1) / 0.002 - 0.95)
    good = np.flatnonzero(total < 0.5)
    far = np.ones(len(setups), np.bool_)
    far[good] = False
    total[far] += weights.refinement + 2.0 * weights.trends + 3.0 * weights.feedback
    if len(good):
        chosen = [setups[k] for k in good]
        total[good] += (
            _refinement(chosen, tables[good], weights) + _trends(chosen, weights) + _feedback(chosen, weights)
        )
    return total


def _tables(setups: Sequence[Setup], substep: float) -> tuple[Array, Outcome]:
    cases = [
        Case(at(machine, tau, substep), setup)
        for setup in setups
        for machine in setup.machines.values()
        for tau in TIME_CONSTANTS
    ]
    out = run_cases(cases)
    entries = np.stack([out.error, out.speed, out.acceleration], axis=-1)
    tables = entries.reshape(len(setups), len(PAPER_TABLE), len(TIME_CONSTANTS), 3).mean(axis=2)
    return np.maximum(tables, 1e-3), out


def _refinement(setups: Sequence[Setup], tables: Array, weights: Weights) -> Array:
    """Return the penalty for a Table I that half a substep changes: chaotic sets do."""
    if weights.refinement == 0.0:
        return np.zeros(len(setups))
    change = np.abs(np.log(_tables(setups, 5e-4)[0] / tables))
    return weights.refinement * (np.sqrt((change**2).mean(axis=(1, 2))) + 0.3 * change.max(axis=(1, 2)))


def _trends(setups: Sequence[Setup], weights: Weights) -> Array:
    """Return the penalty for rank correlations below 0.97: error, path length, speed, and falling peak acceleration."""
    if weights.trends == 0.0:
        return np.zeros(len(setups))
    out = run_cases([Case(at(setup.baseline, tau), setup) for setup in setups for tau in SWEPT])
    found: list[float] = []
    for k in range(len(setups)):
        part = slice(k * len(SWEPT), (k + 1) * len(SWEPT))
        series = (out.error[part], out.path_length[part], out.speed[part], -out.peak[part])
        short = [max(0.0, 0.97 - rank_correlation(SWEPT, values)) for values in series]
        found.append(float(np.mean(short)) + float((~out.completed[part]).mean()))
    return weights.trends * np.array(found)


def _feedback(setups: Sequence[Setup], weights: Weights) -> Array:
    """Return the penalty for what Fig. 10 shows: fall up to 0.06, plateau and growing saturation above 0.1."""
    if weights.feedback == 0.0:
        return np.zeros(len(setups))
    cases = [Case(at(s.baseline, TIME_CONSTANT), s, gain / INCH_POUND) for s in setups for gain in GAINS]
    out = run_cases(cases)
    gains = np.array(GAINS)
    low, high, best = gains <= BEST_GAIN, gains >= PLATEAU_FROM, GAINS.index(BEST_GAIN)
    found: list[float] = []
    for error, saturated, completed in zip(
        *(values.reshape(len(setups), -1) for values in (out.error, out.saturated, out.completed)), strict=True
    ):
        mean = error[high].mean()
        found.append(
            0.5 * max(0.0, 0.97 + rank_correlation(gains[low], error[low]))
            + 2.0 * max(0.0, float(np.abs(error[high] / mean - 1.0).max()) - 0.06)
            + 0.3 * max(0.0, 0.97 - rank_correlation(gains[high], saturated[high]))
            + 3.0 * max(0.0, float(saturated[best]) - SATURATED)
            + float((~completed.astype(np.bool_)).mean())
        )
    return weights.feedback * np.array(found)


# --- the search ---


@dataclass(frozen=True, kw_only=True)
class FitArguments:
    """Arguments of ``pter fit``.

    Attributes
    ----------
    seed
        Seed of the search, at least 0; the same seed and budget give the same result.
    budget
        Evaluated candidates, at least 300. 60,000 take less than half an hour.
    held_out
        Fit Table I alone and keep the trends held out.
    out
        File for the preset; its folder must exist.
    """

    seed: int = 0
    budget: int = 60_000
    held_out: bool = False
    out: Path = Path("pter-preset.toml")


@dataclass(frozen=True)
class Fit:
    """Result of a search.

    Attributes
    ----------
    preset, misfit
        The best preset and its objective.
    table
        Its Table I in the paper's units, (3, 3).
    ensemble
        Points of the last population within 1.2 times the best objective, (K, len(SPACE)), the best first.
    """

    preset: Preset
    misfit: float
    table: Array
    ensemble: Array


POPULATION = 100

CHUNK = 10
"""Candidates that are evaluated in one batch."""


def fit(arguments: FitArguments | None = None, start: Array | None = None) -> Fit:
    """Search the space by scipy's differential evolution and write the best preset.

    Parameters
    ----------
    arguments
        Seed, budget and output.
    start
        Points that join the first population, (K, len(SPACE)).

    Raises
    ------
    ParameterError
        If an argument is out of its range. Nothing has been written.
    """
    arguments = FitArguments() if arguments is None else arguments
    if arguments.seed < 0 or arguments.budget < 3 * POPULATION:
        raise ParameterError(f"fit needs seed ≥ 0 and budget ≥ {3 * POPULATION}, got {arguments}")
    if not arguments.out.resolve().parent.is_dir():
        raise ParameterError(f"out must be a file in a folder that exists, got {str(arguments.out)!r}")
    from scipy import optimize

    weights = TABLE_ONLY if arguments.held_out else Weights()
    generations = arguments.budget // POPULATION - 2
    with progress_bar(Console(stderr=True)) as progress:
        bar = progress.add_task("fit", total=arguments.budget)

        def evaluate(points: Array) -> Array:
            values = _misfits(points.T, weights)
            progress.advance(bar, points.shape[1])
            return values

        population = np.random.default_rng(arguments.seed).random((2 * POPULATION, len(SPACE)))
        first = population[np.argsort(evaluate(population.T), kind="stable")[:POPULATION]]
        if start is not None:
            first[-len(start) :] = start
        search = cast(Any, optimize)
        found = search.differential_evolution(
            evaluate,
            [(0.0, 1.0)] * len(SPACE),
            strategy="currenttobest1bin",
            maxiter=max(generations - 1, 0),
            init=first,
            mutation=(0.4, 0.9),
            recombination=0.8,
            tol=0.0,
            atol=0.0,
            rng=arguments.seed,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
    order = np.argsort(found.population_energies, kind="stable")
    near = order[found.population_energies[order] <= 1.2 * found.fun]
    preset = decode(found.x)
    write_text_atomic(arguments.out, format_preset(preset, f"Found by pter fit, seed {arguments.seed}."))
    return Fit(preset, float(found.fun), table_of(preset), found.population[near])


def _misfits(points: Array, weights: Weights) -> Array:
    parts = [points[k : k + CHUNK] for k in range(0, len(points), CHUNK)]
    return np.concatenate([misfit([decode(point) for point in part], weights) for part in parts])
