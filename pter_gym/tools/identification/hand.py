# pyright: standard
"""Mass, damper and spring of the hand that moves a machine, from clutch pulses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from pter_gym.params import Machine
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.pulses import tip_forces

Array = NDArray[np.float64]

BEFORE, AFTER, KNOT = 0.1, 0.2, 0.02
SAME = 0.1
SLIPPING = 0.15
FOLDS = 10


def tip_positions(machine, theta):
    la, lb = machine.arm.length_a, machine.arm.length_b
    return la * np.stack([np.cos(theta[:, 0]), np.sin(theta[:, 0])], 1) + lb * np.stack(
        [np.cos(theta[:, 1]), np.sin(theta[:, 1])], 1
    )


def switches(log):
    rows = np.flatnonzero(np.abs(np.diff(log.volts, axis=0)).max(axis=1) > SAME) + 1
    apart = np.diff(rows, prepend=-(10**9)) * log.interval > 0.015
    return rows[apart]


def pushes(log, machine, rows, rng, donors=8):
    """State and torques at switches: angles, tip speed, T before, T after and of donors (D+1, N, 4)."""
    curve = machine.clutch.dynamic
    torque = np.vectorize(curve.torque)(log.volts) * np.array(machine.slot_scale)
    past = max(3, round(0.05 / log.interval))
    t = np.arange(past) - (past - 1) / 2
    slope = t / (t @ t) / log.interval
    omega = np.array([slope @ log.theta[r - past : r] for r in rows])
    old, new = torque[rows - 1], torque[rows]
    bits = 1 << np.arange(4)
    was, now = (log.volts[rows - 1] > SAME) @ bits, (log.volts[rows] > SAME) @ bits
    others = [np.flatnonzero((now != w)) for w in range(16)]
    pick = np.array([rng.choice(others[w], donors) for w in was])  # (N, D)
    return omega, old, np.concatenate([new[None], new[pick.T]])


def tests(interval, before, after, knot, shift=0.0):
    """Test functions: (3, k, n)."""
    n0, n1 = round(before / interval), round(after / interval)
    t = interval * np.arange(-n0, n1 + 1)
    count = int((before + after) / knot + 1e-9)
    knots = -before + knot * np.arange(count + 1)
    found = []
    for nu in range(3):
        rows = []
        for k in range(count - 5):
            b = BSpline.basis_element(knots[k : k + 7], extrapolate=False)
            b = b if not nu else b.derivative(nu)
            rows.append(np.nan_to_num(b(t - shift)))
        found.append(np.array(rows) * interval)
    return np.array(found), n0, n1


def columns(parts, iso):
    cols = []
    for part in parts:
        if iso:
            cols.append(part); continue
        for d, e in ((0, 0), (0, 1), (1, 1)):
            col = np.zeros_like(part)
            col[:, :, d] += part[:, :, e]
            if d != e:
                col[:, :, e] += part[:, :, d]
            cols.append(col)
    return cols


def response(machine, log, rows, p, theta, n0, n1, iso):
    omega, old, new = p
    arm = machine.arm
    mats = []
    for i in range(3):
        if iso: mats.append(theta[i] * np.eye(2)); continue
        a, b, c = theta[3 * i : 3 * i + 3]
        mats.append(np.array([[a, b], [b, c]]))
    w = [np.linalg.eigh(m) for m in mats]
    K, B, M = (v @ np.diag(np.clip(l, lo, hi)) @ v.T for (l, v), lo, hi in zip(w, (20, 1, 0.1), (2000, 100, 5)))
    angles = log.theta[rows - 1]
    tips = tip_forces(machine, angles)  # (N, 4, 2), newtons per N·m
    unit = joint_forces(machine, angles)
    off = arm.coupling * np.cos(angles[:, 0] - angles[:, 1])
    inertia = np.empty((len(rows), 2, 2))
    inertia[:, 0, 0], inertia[:, 1, 1] = arm.inertia_a, arm.inertia_b
    inertia[:, 0, 1] = inertia[:, 1, 0] = off
    T = unit.transpose(0, 2, 1) @ inertia @ unit
    inv = np.linalg.inv(T + M)
    W = np.array(machine.slot_rows)
    slip0 = omega @ W.T  # (N, 4)
    back = np.einsum("xi,nid->nxd", W, unit)  # slip per tip velocity
    base = old * np.tanh(slip0 / SLIPPING)
    sims = len(new)
    x = np.zeros((n1 + 1, sims, len(rows), 2))
    vs = np.zeros_like(x); acs = np.zeros_like(x)
    pos = np.zeros((sims, len(rows), 2)); vel = np.zeros_like(pos)
    h = log.interval; sub = max(1, round(h / 2e-3)); h /= sub
    for n in range(n1):
        for s in range(sub):
            t = (n + (s + 0.5) / sub) * log.interval - machine.delay
            rise = 1 - np.exp(-max(t, 0.0) / machine.clutch.time_constant)
            slip = slip0 + np.einsum("nxd,snd->snx", back, vel)
            brake = (old + rise * (new - old)) * np.tanh(slip / SLIPPING) - base
            load = -np.einsum("snx,nxd->snd", brake, tips) - pos @ K - vel @ B
            acc = np.einsum("nde,sne->snd", inv, load)
            vel = vel + h * acc
            pos = pos + h * vel
        x[n + 1], vs[n + 1], acs[n + 1] = pos, vel, acc
    def centred(w):
        out = np.zeros((len(rows), n0 + n1 + 1, 2))
        out[:, n0:] = (w[:, 0] - w[:, 1:].mean(axis=1)).transpose(1, 0, 2)
        return out
    xc = centred(x)
    return xc, -xc @ K - centred(vs) @ B - centred(acs) @ M


def joint_forces(machine, theta):
    """J^-1 (N, 2, 2): joint speeds per tip speed; = tip_forces for rows e1, e2."""
    arm = machine.arm
    lengths = np.array([arm.length_a, arm.length_b])
    sine, cosine = lengths * np.sin(theta), lengths * np.cos(theta)
    size = -sine[:, 0] * cosine[:, 1] + sine[:, 1] * cosine[:, 0]
    return np.stack(
        [np.stack([cosine[:, 1], sine[:, 1]], 1), np.stack([-cosine[:, 0], -sine[:, 0]], 1)], 1
    ) / size[:, None, None]


@dataclass
class Fit:
    theta: Array
    cov: Array
    windows: int
    delay: float


def fit(log: Log, machine: Machine, before=BEFORE, after=AFTER, knot=KNOT, delays=True, iso=False):
    rows = switches(log)
    phi, n0, n1 = tests(log.interval, before, after, knot)
    rows = rows[(rows >= max(n0, 60)) & (rows + n1 < len(log.theta))]
    clear = log.is_clear(1)
    rows = rows[[clear[r - n0 : r + n1 + 1].all() for r in rows]]
    p = pushes(log, machine, rows, np.random.default_rng(0))
    x = tip_positions(machine, log.theta)
    index = rows[:, None] + np.arange(-n0, n1 + 1)
    X, F = x[index], log.force[index]  # (N, n, 2)
    X = X - X[:, :1]
    def through(k, what, f=phi):
        return np.einsum("kn,jnd->jkd", f[k], what)
    parts = [through(0, X), -through(1, X), through(2, X)]  # K, B, M
    N, k = len(rows), phi.shape[1]
    delay, theta = 0.0, np.array([300.0, 0, 300, 14, 0, 14, 1.2, 0, 1.2] + [0.0] * delays)
    if iso: theta = np.array([300.0, 14, 1.2] + [0.0] * delays)
    for step in range(6):
        shifted, _, _ = tests(log.interval, before, after, knot, delay)
        y = through(0, F, shifted).reshape(N, -1)
        C = columns(parts, iso)
        if delays:
            C.append(-through(1, F, shifted))
        C = np.stack([c.reshape(N, -1) for c in C], axis=2)  # (N, m, q)
        y = y - y.mean(0); C = C - C.mean(0)
        e = y + C @ theta
        e2 = e.reshape(N, k, 2).transpose(0, 2, 1).reshape(2 * N, k)
        S = e2.T @ e2 / len(e2)
        W = np.kron(np.linalg.inv(S + 1e-9 * np.trace(S) / len(S) * np.eye(len(S))), np.eye(2))
        r, rf = response(machine, log, rows, p, theta, n0, n1, iso)
        hat = columns([through(0, r), -through(1, r), through(2, r)], iso)
        if delays:
            hat.append(-through(1, rf))
        hat = np.stack([c.reshape(N, -1) for c in hat], axis=2)
        H = np.einsum("jmq,mn->jnq", hat, W)
        A = np.einsum("jnq,jnr->qr", H, C)
        b = -np.einsum("jnq,jn->q", H, y)
        theta = np.linalg.solve(A, b)
        if delays:
            delay += theta[-1] if step < 5 else 0.0
            theta[-1] = 0.0
    e = y + C @ theta
    s = np.einsum("jnq,jn->jq", H, e)
    Ai = np.linalg.inv(A)
    cov = Ai @ (s.T @ s) @ Ai.T * N / (N - len(theta))
    return Fit(theta, cov, N, delay)
