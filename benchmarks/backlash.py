"""Play in a clutch's gear: what it costs to compute, and what it would take from policies.

    python benchmarks/backlash.py order
    python benchmarks/backlash.py peer
    python benchmarks/backlash.py policies

``order`` compares substeps that stay in closed form with an event-driven solution, ``peer`` that
solution with MuJoCo's; ``policies`` says how much of the couplings' torque falls into a play of
0.3°, by replaying recorded episodes.
docs/development/hysteresis.md has the results.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import resolve
from pter_gym.params import BASELINE

Array = NDArray[np.float64]

W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
PLAY = math.radians(0.3)
"""From one end to the other [rad]."""

CAPACITY, END, START = 6.0, 2.0, (np.array([0.5, 2.0]), np.array([0.3, -0.1]))
"""Torque of clutch 4 [N·m], the only one; end [s], and angles and velocities before."""


def load(t: float) -> Array:
    """Return torques on the links [N·m] that turn the slip of clutch 4 around, and hold it."""
    return np.array([9.0 * math.sin(7.0 * t), 2.0 * math.cos(3.0 * t) + 3.0 * math.sin(5.0 * t)])


def inertia(theta: Array) -> Array:
    """Return the mass matrix [kg·m²]."""
    arm = BASELINE.arm
    m12 = arm.coupling * math.cos(theta[0] - theta[1])
    return np.array([[arm.inertia_a, m12], [m12, arm.inertia_b]])


def velocity_term(theta: Array, omega: Array) -> Array:
    """Return V of Eqs. 3 and 4 [N·m]."""
    size = BASELINE.arm.coupling * math.sin(theta[0] - theta[1])
    return np.array([size * omega[1] ** 2, -size * omega[0] ** 2])


def stepped(h: float, *, shares: bool) -> Array:
    """Return the angles at ``END`` by substeps of h [s] whose friction is one-sided at a play's end.

    At the end of its play a clutch can only push back: its potential is c·max(s, 0), which is that
    of half its capacity and a constant torque. ``shares`` scales it by the part of the substep that
    is spent there.
    """
    (theta, omega), gear = START, 0.0
    row, half = W[3], 0.5 * PLAY
    for k in range(round(END / h)):
        theta = theta + 0.5 * h * omega
        slip = row @ omega
        gear += 0.5 * h * slip
        sided = np.array([gear >= half, gear <= -half], float)
        if shares and slip != 0.0:
            end = 0 if slip > 0.0 else 1
            sided[end] = min(max(0.5 + (abs(gear) - half) / (h * abs(slip)), 0.0), 1.0)
            sided[end] *= gear * slip > 0.0
        gear = min(max(gear, -half), half)
        up, down = (CAPACITY * sided).tolist()
        m = inertia(theta)
        p = m @ omega + h * (load((k + 0.5) * h) - velocity_term(theta, omega))
        p = p - h * 0.5 * (up - down) * row
        most = PerClutch(0.0, 0.0, 0.0, h * 0.5 * (up + down))
        omega = np.array(resolve(m[0, 0], m[0, 1], m[1, 1], p[0], p[1], most))
        theta = theta + 0.5 * h * omega
        gear += 0.5 * h * (row @ omega)
    return theta


class Phase(NamedTuple):
    """What clutch 4 does: at which end of its play (0: within it), and whether it slips there."""

    end: int
    slips: bool


def exact() -> tuple[Array, int]:
    """Return the angles at ``END``, and how often the play ends or begins, from smooth phases."""
    row, half = W[3], 0.5 * PLAY
    state, t, phase, changes = np.concatenate([*START, [0.0]]), 0.0, Phase(0, False), 0

    def holding(t: float, y: Array) -> float:
        """Return the torque that keeps the slip as it is."""
        theta, omega = y[:2], y[2:4]
        inverse = np.linalg.inv(inertia(theta))
        return float(
            -(row @ inverse @ (load(t) - velocity_term(theta, omega))) / (row @ inverse @ row)
        )

    def rates(t: float, y: Array) -> Array:
        theta, omega = y[:2], y[2:4]
        torque = 0.0
        if phase.end:
            torque = -phase.end * CAPACITY if phase.slips else holding(t, y)
        force = load(t) - velocity_term(theta, omega) + torque * row
        moving = 0.0 if phase.end else row @ omega
        return np.concatenate([omega, np.linalg.solve(inertia(theta), force), [moving]])

    def ends_of(phase: Phase) -> list[Any]:
        if not phase.end:
            return [lambda t, y: y[4] - half, lambda t, y: -y[4] - half]
        if phase.slips:
            return [lambda t, y: -phase.end * (row @ y[2:4])]
        pushes = [lambda t, y: -phase.end * holding(t, y) - CAPACITY]
        return [*pushes, lambda t, y: phase.end * holding(t, y)]

    while t < END:
        events = ends_of(phase)
        for event in events:
            event.terminal, event.direction = True, 1
        run = solve_ivp(
            rates, (t, END), state, "DOP853", events=events, rtol=1e-11, atol=1e-13, max_step=0.01
        )
        t, state = float(run.t[-1]), run.y[:, -1]
        if run.status != 1:
            break
        changes += 1
        which = next(k for k, each in enumerate(run.t_events) if len(each))
        if not phase.end:
            phase = Phase(1 if which == 0 else -1, True)
            state[4] = phase.end * half
        elif phase.slips:
            needed = -phase.end * holding(t, state)
            phase = Phase(phase.end, False) if 0.0 <= needed <= CAPACITY else Phase(0, False)
        else:
            phase = Phase(phase.end, True) if which == 0 else Phase(0, False)
    return state[:2], changes


def order() -> None:
    """Print errors of the tip's angles over the substep."""
    true, changes = exact()
    print(f"{changes} changes of phase")
    for h in (10e-3, 5e-3, 2.5e-3, 1.25e-3, 0.625e-3, 0.3125e-3):
        errors = [np.abs(stepped(h, shares=shares) - true).max() for shares in (False, True)]
        print(f"{1e3 * h:7.4f} ms", *(f"{1e3 * error:10.5f} mrad" for error in errors))


def geared(step: float, rotor: float) -> Any:
    """Return MuJoCo's arm; clutch 4 brakes a rotor [kg·m²] that a limited tendon ties to the links.

    The arm is that of mujoco_arm.py: a chain with the angles (A, B − A) and a point-like link B.
    """
    import mujoco

    arm, half, hard = BASELINE.arm, 0.5 * PLAY, "0.9999 0.9999 0.001 0.5 2"
    mass = abs(arm.coupling) / arm.length_a**2 * math.sqrt(arm.inertia_a / arm.inertia_b)
    centre = arm.coupling / (mass * arm.length_a)
    a, b = arm.inertia_a - mass * arm.length_a**2, arm.inertia_b - mass * centre**2
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <compiler angle="radian" boundmass="0" boundinertia="0"/>
      <option timestep="{step}" gravity="0 0 0" solver="Newton" iterations="100" tolerance="1e-12"
              noslip_iterations="200" noslip_tolerance="1e-20"/>
      <worldbody>
        <body>
          <joint name="a" type="hinge" axis="0 0 1"/>
          <inertial pos="0 0 0" mass="1" diaginertia="{a} {a} {a}"/>
          <body pos="{arm.length_a} 0 0">
            <joint name="ba" type="hinge" axis="0 0 1"/>
            <inertial pos="{centre} 0 0" mass="{mass}" diaginertia="{b} {b} {b}"/>
          </body>
        </body>
        <body>
          <joint name="rotor" type="hinge" axis="0 0 1" frictionloss="{CAPACITY}"
                 solreffriction="{2.0 * step} 1" solimpfriction="{hard}"/>
          <inertial pos="0 0 0" mass="1" diaginertia="{rotor} {rotor} {rotor}"/>
        </body>
      </worldbody>
      <tendon>
        <fixed limited="true" range="{-half} {half}" solreflimit="{4.0 * step} 1"
               solimplimit="{hard}">
          <joint joint="a" coef="2"/><joint joint="ba" coef="1"/><joint joint="rotor" coef="-1"/>
        </fixed>
      </tendon>
    </mujoco>""")


def peer() -> None:
    """Print how far MuJoCo's angles are from the event-driven ones."""
    import mujoco

    true, _ = exact()
    for step, rotor in ((5e-5, 1e-3), (2e-5, 1e-4), (1e-5, 1e-4)):
        model = geared(step, rotor)
        data, ((a, b), (rate_a, rate_b)) = mujoco.MjData(model), START
        data.qpos[:], data.qvel[:] = (a, b - a, a + b), (rate_a, rate_b - rate_a, 0.0)
        for k in range(round(END / step)):
            of_a, of_b = load((k + 0.5) * step)
            data.qfrc_applied[:2] = of_a + of_b, of_b
            mujoco.mj_step(model, data)
        error = np.abs(np.cumsum(data.qpos[:2]) - true).max()
        print(f"{1e6 * step:g} µs, rotor {rotor:g} kg·m²: {1e3 * error:.4f} mrad")


def policies(names: tuple[str, ...] = ("single-dof-tuned", "residual", "universal")) -> None:
    """Print how much of the couplings' torque would fall into a play, in recorded episodes."""
    from pter_gym.benchmark import find_policy
    from pter_gym.benchmark.episodes import training_episodes
    from pter_gym.benchmark.rollout import record_episodes
    from pter_gym.scenarios import find_scenario
    from pter_gym.tasks.path_following import COLUMN

    for scenario in ("standard", "paths"):
        episodes = training_episodes(find_scenario(scenario), "medium", 24, 7)
        for name in names:
            rows = record_episodes(find_policy(name, scenario), episodes).telemetry
            theta, torque = (rows[..., [*at]] for at in (COLUMN.theta, COLUMN.torque))
            print(scenario, name, *(f"{share:.1%}" for share in _in_play(theta, torque)))


def _in_play(theta: Array, torque: Array) -> list[float]:
    """Return the shares of the torque's time integral of clutches 3 and 4 within their play."""
    shares = []
    for clutch in (2, 3):
        turned, force = theta @ W[clutch], np.abs(torque[..., clutch])
        gear, free, whole = np.zeros(turned.shape[1:]), 0.0, 0.0
        for before, now, held in zip(turned[:-1], turned[1:], force[1:], strict=True):
            alive = np.isfinite(now) & np.isfinite(held)
            gear = np.clip(gear + np.where(alive, now - before, 0.0), -0.5 * PLAY, 0.5 * PLAY)
            free += float(held[alive & (np.abs(gear) < 0.5 * PLAY)].sum())
            whole += float(held[alive].sum())
        shares.append(free / whole)
    return shares


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({each.__name__: each for each in (order, peer, policies)})
