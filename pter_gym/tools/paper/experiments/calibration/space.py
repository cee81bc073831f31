"""The search space, and the preset at each of its points: every candidate obeys the rules by construction."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pter_gym.params import BREAKAWAY_SMALL_VOLTAGE, TIME_CONSTANT, Arm, TorqueCurve
from pter_gym.params._preset import PRESET, ClutchValues, Preset, SensingValues
from pter_gym.paths import Line
from pter_gym.tools.paper.experiments.feedback import BEST_GAIN
from pter_gym.units import INCH_POUND

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Free:
    """One searched number: its range and the reason for it."""

    name: str
    unit: str
    low: float
    high: float
    reason: str
    logarithmic: bool = False


LEAST_RATIO = 1.12
"""Least T_s/T_k of clutches that stick and slip."""

SPACE: tuple[Free, ...] = (
    Free("length_a", "m", 0.3, 0.66, "PTER's links were of the order of half a metre"),
    Free("length_b", "m", 0.3, 0.66, "PTER's links were of the order of half a metre"),
    Free("inertia_a", "kg·m²", 0.25, 2.0, "aluminium links, with clutch rotors and gears", True),
    Free("inertia_b", "kg·m²", 0.25, 2.0, "aluminium links, with clutch rotors and gears", True),
    Free("coupling", "1", -0.6, 0.6, "relative to √(M11·M22): the mass matrix stays well conditioned"),
    Free("small_voltage", "V", 4.0, 8.0, "where breakaway is 63.5 in·lbf: a small voltage, not below the tests"),
    Free("knee", "V", 8.0, 22.0, "the linear segment holds the small voltages"),
    Free("top_torque", "N·m", 15.0, 70.0, "dynamic torque at 24 V of clutches of this kind"),
    Free("breakaway_ratio", "1", LEAST_RATIO, 1.5, "T_s/T_k: Fig. 9 shows a clear jump"),
    Free("delrin_jump", "1", 0.65, 1.6, "T_s/T_k − 1 over the present clutches': Fig. 9 shows similar jumps"),
    Free("delrin_scale", "1", 0.5, 0.95, "experimental Delrin has less friction than the present clutches"),
    Free("mu_dynamic", "1", 0.37, 0.45, "of the present clutches: above Delrin's 0.35, at most the published μs"),
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

EQ5_PEAK = 0.6173
"""Largest |Fn|/Fmax of Eq. 5."""

TABLE_VOLTS = (0.0, 4.0, 10.0, 17.0, 24.0)

ORIGINS = {
    **PRESET.provenance,
    "delrin.mu_dynamic_present": "fitted: above 0.35 of Delrin, at most the published static one",
}

DIGITS = 4
"""Significant digits of a candidate: what is written is what was evaluated."""


def decode(point: Array) -> Preset:
    """Return the preset at a point of the unit cube, shape (len(SPACE),). Every point gives an admissible preset."""
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
        arm=arm,
        clutch=ClutchValues(
            slope=curve.slope,
            knee=curve.knee,
            curvature=curve.curvature,
            breakaway_ratio=rounded(values["breakaway_ratio"]),
            time_constant=TIME_CONSTANT,
            voltage_max=TABLE_VOLTS[-1],
            scale=(1.0,) * 4,
        ),
        delrin={
            "dynamic_scale": rounded(values["delrin_scale"]),
            "breakaway_ratio": rounded(
                max(LEAST_RATIO, 1.0 + values["delrin_jump"] * (values["breakaway_ratio"] - 1.0))
            ),
            "mu_dynamic_present": rounded(values["mu_dynamic"]),
        },
        path={"x": line.x, "y": line.y, "direction": line.direction, "length": line.length},
        hand={"push": rounded(values["push"]), "force_max": rounded(values["disturbance"] * room)},
        controller={
            "stiffness": rounded(values["stiffness"]),
            "damping_normal": rounded(damping),
            "damping_tangential": rounded(min(values["damping_tangential"], along / 0.01)),
            "slip_threshold": rounded(values["slip_threshold"]),
            "table_volts": TABLE_VOLTS,
            "feedback": BEST_GAIN / INCH_POUND,
        },
        sensing=SensingValues(delay=0.0),
        provenance=ORIGINS,
    )


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
