"""The paper's own rule for the clutch torques: a case statement over six modes, with "the weakest
slips".

Swanson, Romagna and Book, section III-A. The paper decides torques first and gets accelerations
from them; the package decides velocities first. Both answer the same question, so this is kept as
another voice, not as the truth.

    two DOF    every clutch slips: dynamic torque against its slip (Eq. 2, first line). one DOF
    the others slip; the stuck clutch takes what keeps it stuck, unless that exceeds its breakaway
    torque. zero DOF   at most two clutches engaged: each takes what keeps it stuck, unless that
    exceeds its breakaway torque;
               more: the lumped actuator approach. If some set of torques below breakaway holds the
               arm, it stays. If none does, the weakest engaged clutch slips and the rest is tested
               again.

What the paper leaves open is read as follows. The weakest clutch is the engaged one with the lowest
breakaway torque. A clutch that begins to slip has its breakaway torque (Eq. 2, last line), against
the slip that the load would give the arm were no clutch engaged. When one of two stuck clutches
yields, the other is tested again. When both yield, both have their breakaway torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

W = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
TWO_DOF, ZERO_DOF = 0, 5


@dataclass(frozen=True)
class Answer:
    """Acceleration of the links (2,) and the clutches that stay stuck, a mode as in the package."""

    acceleration: np.ndarray
    mode: int


@dataclass(frozen=True)
class ClutchProblem:
    """Mass matrix (2, 2), load without the clutches (2,), slips (4,), breakaway and dynamic torques
    (4,)."""

    mass: np.ndarray
    load: np.ndarray
    slip: np.ndarray
    breakaway: np.ndarray
    dynamic: np.ndarray


def decide(now: ClutchProblem) -> Answer:
    """What the case statement says for a state whose slips are either zero or well outside the
    Karnopp band."""
    stuck = np.flatnonzero(now.slip == 0.0)
    if stuck.size == 0:
        return _slide(now, now.load - W.T @ (now.dynamic * np.sign(now.slip)))
    if stuck.size == 1:
        return _one_stuck(now, int(stuck[0]), now.load - W.T @ (now.dynamic * np.sign(now.slip)))
    engaged = [x for x in range(4) if now.breakaway[x] > 0.0]
    if len(engaged) > 2 and _can_hold(now.load, now.breakaway):
        return Answer(np.zeros(2), ZERO_DOF)
    return _from_rest(now, engaged)


def _from_rest(now: ClutchProblem, engaged: list[int]) -> Answer:
    """Let the weakest slip until two clutches are left, then ask those."""
    intent = np.sign(W @ np.linalg.solve(now.mass, now.load))
    left, load = sorted(engaged, key=lambda x: now.breakaway[x]), now.load.copy()
    while len(left) > 2:
        weakest = left.pop(0)
        load -= W[weakest] * now.breakaway[weakest] * intent[weakest]
    if len(left) == 2:
        return _two_stuck(now, left, load)
    if len(left) == 1:
        return _one_stuck(now, left[0], load)
    return _slide(now, load)


def _two_stuck(now: ClutchProblem, pair: list[int], load: np.ndarray) -> Answer:
    needed = np.linalg.solve(W[pair].T, load)
    yields = [x for x, torque in zip(pair, needed, strict=True) if abs(torque) > now.breakaway[x]]
    for x, torque in zip(pair, needed, strict=True):
        if x in yields:
            load = load - W[x] * now.breakaway[x] * np.sign(torque)
    holds = [x for x in pair if x not in yields]
    if len(holds) == 2:
        return Answer(np.zeros(2), ZERO_DOF)
    return _one_stuck(now, holds[0], load) if holds else _slide(now, load)


def _one_stuck(now: ClutchProblem, x: int, load: np.ndarray) -> Answer:
    """Keep clutch x stuck if its breakaway torque allows that; `load` includes every other
    clutch."""
    response = np.linalg.solve(now.mass, W[x])
    needed = (response @ load) / (response @ W[x])
    if abs(needed) > now.breakaway[x]:
        return _slide(now, load - W[x] * now.breakaway[x] * np.sign(needed))
    line = np.array([W[x][1], -W[x][0]])
    return Answer(line * (line @ load) / (line @ now.mass @ line), x + 1)


def _slide(now: ClutchProblem, load: np.ndarray) -> Answer:
    return Answer(np.linalg.solve(now.mass, load), TWO_DOF)


def _can_hold(load: np.ndarray, torque: np.ndarray) -> bool:
    """Whether the load lies in the zonotope Wᵀt, |t_x| ≤ torque_x: four pairs of parallel sides."""
    normals = np.stack([W[:, 1], -W[:, 0]], axis=1)
    return bool(np.all(np.abs(normals @ load) <= np.abs(normals @ W.T) @ torque))
