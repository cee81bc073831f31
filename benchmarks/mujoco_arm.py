"""The same mechanism in MuJoCo: an open two-link tree with four tendons with friction.

The five-bar parallelogram moves like its two links A and B, with the kinetic energy
½ M11 A'² + c cos(A − B) A' B' + ½ M22 B'². An open chain whose second link hangs on the end of the
first has the same energy: joint angles (A, B − A), and with a point-like second link of mass m
whose centre lies r beyond the elbow

    M11 = (inertia of the first link) + m l_A²,    c = m l_A r,    M22 = (inertia of the second
    link) + m r².

A clutch is a fixed tendon with friction loss: its slip as a ratio of the joint rates, A' = (1, 0),
B' = (1, 1), A' − B' = (0, −1), A' + B' = (2, 1).

It takes plain numbers and knows nothing of this package's physics: the tests use it as an
independent peer. MuJoCo is imported when a model is built."""

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

RATIOS = np.array([[1, 0], [1, 1], [0, -1], [2, 1]])
"""Slip of clutch x per rate of the joints (A, B − A)."""


@dataclass(frozen=True)
class ArmNumbers:
    """Link lengths [m] and the three inertial numbers M11, M22, c [kg·m²]."""

    length_a: float
    length_b: float
    inertia_a: float
    inertia_b: float
    coupling: float


def build(
    arm: ArmNumbers,
    step: float,
    torque: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    *,
    soft: bool = False,
) -> Any:
    """Return a model with two force actuators at the tip (world x and y) and clutch torques as
    friction losses.

    Friction loss is a soft constraint in MuJoCo. In the direct form ``solreffriction = (−stiffness,
    −damping)`` a damping of 0.9999/step over an impedance of 0.9999 asks for zero slip after
    exactly one step, and the no-slip iterations remove what softness is left.

    Parameters
    ----------
    arm, step
        The mechanism, and the time step [s].
    torque
        Friction loss of each clutch [N·m].
    soft
        Leave the constraint and the solver at MuJoCo's defaults: faster, but a stuck clutch creeps.
    """
    mujoco: Any = importlib.import_module("mujoco")
    mass = (
        abs(arm.coupling) / arm.length_a**2 * math.sqrt(arm.inertia_a / arm.inertia_b)
        if arm.coupling
        else 1e-3
    )
    centre = arm.coupling / (mass * arm.length_a)
    link_a = arm.inertia_a - mass * arm.length_a**2
    link_b = arm.inertia_b - mass * centre**2
    hardness = (
        ""
        if soft
        else f'solreffriction="-1 {-0.9999 / step!r}" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    )
    hard_solver = (
        'iterations="100" tolerance="1e-12" noslip_iterations="200" noslip_tolerance="1e-20"'
    )
    tendons = "".join(
        f'<fixed name="clutch{x + 1}" frictionloss="{float(loss)!r}" {hardness}>'
        f'<joint joint="a" coef="{ratio[0]}"/><joint joint="ba" coef="{ratio[1]}"/></fixed>'
        for x, (ratio, loss) in enumerate(zip(RATIOS, np.maximum(torque, 1e-300), strict=True))
    )
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <compiler angle="radian" boundmass="0" boundinertia="0"/>
      <option timestep="{step!r}" gravity="0 0 0" integrator="Euler" solver="Newton"
              {"" if soft else hard_solver}>
        <flag eulerdamp="disable" contact="disable" warmstart="enable"/>
      </option>
      <worldbody>
        <site name="world"/>
        <body>
          <joint name="a" type="hinge" axis="0 0 1"/>
          <inertial pos="0 0 0" mass="1" diaginertia="{link_a!r} {link_a!r} {link_a!r}"/>
          <body pos="{arm.length_a!r} 0 0">
            <joint name="ba" type="hinge" axis="0 0 1"/>
            <inertial pos="{centre!r} 0 0" mass="{mass!r}"
                      diaginertia="{link_b!r} {link_b!r} {link_b!r}"/>
            <site name="tip" pos="{arm.length_b!r} 0 0"/>
          </body>
        </body>
      </worldbody>
      <tendon>{tendons}</tendon>
      <actuator>
        <general name="force_x" site="tip" refsite="world" gear="1 0 0 0 0 0"/>
        <general name="force_y" site="tip" refsite="world" gear="0 1 0 0 0 0"/>
      </actuator>
    </mujoco>""")
    model.tendon_frictionloss[:] = torque
    return model
