"""Gradients: the friction step in each mode, each stage against JAX's autodiff, rollouts against
paired ones."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from compiled_friction import resolve_friction
from pter_gym import gradients, initial_state, simulate
from pter_gym._compiled.records import flat, store
from pter_gym._physics.arm import Load
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.friction import ClutchMode
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of
from pter_gym._physics.step import paper_clutches
from pter_gym.errors import DivergenceError, ParameterError
from pter_gym.gradients import _rollout
from pter_gym.gradients._adjoint import FIRST, LAST, aim, drift, kernels, kick_adjoints, kick_stages
from pter_gym.gradients._branchless import Column, branchless
from pter_gym.gradients._friction import resolve_adjoint
from pter_gym.gradients._machine import by_machine
from pter_gym.gradients._tangent import KICK, stages_in_span
from pter_gym.gradients._tracing import adjoint_of, tangent_of
from pter_gym.params import BASELINE, MACHINES, Hand, Machine
from pter_gym.params._spread import numbers_of, with_numbers

EPS = float(np.finfo(float).eps)
MANY = pytest.mark.parametrize("count", [300, pytest.param(10_000, marks=pytest.mark.long)])
"""How many problems, in each mode."""

SUBSTEP = BASELINE.substep
STAGES = kick_stages(paper_clutches)


def random_problem(rng: np.random.Generator) -> np.ndarray:
    m11, m22 = np.exp(rng.uniform(-2.0, 1.0, 2))
    c = rng.uniform(0.0, 1.0, 4) * rng.integers(0, 2, 4)
    p = rng.normal(size=2) * np.exp(rng.uniform(-2.0, 1.0)) * (0.1 + c.sum())
    return np.array([m11, rng.uniform(-0.9, 0.9) * np.sqrt(m11 * m22), m22, *p, *c])


def friction_adjoint(x: np.ndarray, omega: Any, by: Any) -> np.ndarray:
    return np.array(resolve_adjoint(*x[:5], PerClutch(*x[5:]), None, *omega, *by))


@MANY
def test_the_friction_step_has_the_derivative_of_central_differences_in_each_mode(count: int):
    """Along a random direction, 10⁻⁶ of each number either way; κ is the condition of M.

    A central difference of M⁻¹ misses (10⁻⁶·κ)²·κ of the scale of ω, and loses ε·κ over 2·10⁻⁶ to
    rounding; ten times that for the sums of a problem."""
    rng, found, step = np.random.default_rng(0), dict.fromkeys(ClutchMode, 0), 1e-6
    while min(found.values()) < count:
        x = random_problem(rng)
        *omega, mode = resolve_friction(*x)
        if found[mode] >= count:
            continue
        z, by = rng.normal(size=9) * (np.abs(x) + 1e-3), rng.normal(size=2)
        z[5:] *= x[5:] > 0.0
        *high, at_high = resolve_friction(*(x + step * z))
        *low, at_low = resolve_friction(*(x - step * z))
        if not at_high == mode == at_low:
            continue
        found[mode] += 1
        difference = np.dot(by, np.subtract(high, low)) / (2.0 * step)
        compliance = (x[0] + x[2]) / (x[0] * x[2] - x[1] ** 2)
        condition = compliance * (x[0] + x[2])
        scale = np.abs(by).sum() * compliance * (np.abs(x[3:]).sum() + 0.1)
        tolerance = 10.0 * scale * ((step * condition) ** 2 * condition + EPS * condition / step)
        assert friction_adjoint(x, omega, by) @ z == pytest.approx(difference, abs=tolerance)


@MANY
def test_friction_never_amplifies_a_change_of_momentum(count: int):
    """In the norm of M, ∂ω⁺/∂p is a projection: its largest singular value is 1, or 0 at rest, to
    κ·ε."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        x = random_problem(rng)
        *omega, mode = resolve_friction(*x)
        by_p = np.array([friction_adjoint(x, omega, by)[3:5] for by in np.eye(2)])
        factor = np.linalg.cholesky(np.array([[x[0], x[1]], [x[1], x[2]]]))
        size = np.linalg.norm(factor.T @ by_p @ factor, 2)
        condition = (x[0] + x[2]) ** 2 / (x[0] * x[2] - x[1] ** 2)
        assert size == pytest.approx(
            0.0 if mode == ClutchMode.ZERO_DOF else 1.0, abs=10.0 * condition * EPS
        )


@cache
def twin(stage: Any) -> Any:
    """A stage as a function of JAX: from a column's numbers, and scalars, to those after it and
    what it returns."""
    from pter_gym.gradients.jax import MEANING

    made = branchless(stage, MEANING, {})

    def run(numbers: Any, *arguments: Any) -> Any:
        import jax.numpy as jnp

        column = Column(dict(enumerate(numbers)))
        returned = made(column, 0, *arguments)
        return jnp.stack([*map(jnp.asarray, column.rows.values())]), returned

    return run


def random_body(rng: np.random.Generator) -> Any:
    """A machine with everything, moving, sticking at one clutch or at rest, under a random load."""
    hand = Hand(mass=0.3, damping=6.0, stiffness=40.0)
    arm = replace(BASELINE.arm, dry_a=0.2, dry_b=0.1, viscous_a=0.1, viscous_b=0.2)
    line = np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [1.0, -1.0]])[rng.integers(4)]
    omega = (rng.normal(0.0, 0.03, 2), rng.normal(0.0, 0.05) * line, np.zeros(2))[
        rng.choice(3, p=(0.6, 0.3, 0.1))
    ]
    volts = np.minimum(24.0, 1e-3 + rng.exponential(5.0, 4))
    machine = replace(BASELINE, hand=hand, arm=arm)
    body: Any = body_of(
        machine, initial_state(machine, rng.uniform(-np.pi, np.pi, 2), omega, volts)
    )
    store(body, BODY.load, 0, Load(*rng.normal(0.0, 40.0, 2), 0.0, 0.0, *rng.normal(0.0, 0.5, 2)))
    store(body, BODY.command, 0, PerClutch(*rng.uniform(0.0, 24.0, 4)))
    aim(body, 0, False)
    return body


@pytest.mark.parametrize(
    "name", [*(pytest.param(x, marks=pytest.mark.long) for x in ("aim", "drift", "find")), "share"]
)
def test_each_stage_has_the_adjoint_that_autodiff_of_its_twin_in_jax_has(name: str):
    """Two derivations of the same sums: they differ by rounding, at most ε·κ of a number times its
    derivatives."""
    jax = pytest.importorskip("jax")
    stage = {"aim": aim, "drift": drift, "find": STAGES.find, "share": STAGES.share}[name]
    constants = (True,) if name in ("aim", "drift") else ()
    scalars = (SUBSTEP,) if name in ("drift", "find") else ()
    rng, checked, back = (
        np.random.default_rng(2),
        0,
        adjoint_of(stage, *(["h"] * len(scalars)), constants=constants),
    )
    outputs = [
        BODY.omega.a,
        BODY.omega.b,
        *BODY.impact,
        *BODY.capacity,
        *range(FIRST, LAST),
        *flat(BODY.steady),
    ]
    with jax.enable_x64(True):
        run = twin(stage)

        def total(numbers: Any, given: Any, by: Any) -> Any:
            after, returned = run(numbers, *given, *constants)
            return after @ by + (0.0 if returned is None else returned)

        differentiate = jax.jit(jax.grad(total, (0, 1)))
        while checked < 60:
            body = random_body(rng)
            if name == "share":
                STAGES.find(body, 0, SUBSTEP)
                if body[BODY.switches, 0] == 0.0 or not STAGES.share(body, 0) < 1.0:
                    continue
            by = np.zeros(BODY_WIDTH)
            by[outputs] = rng.normal(size=len(outputs))
            bar = by[:, None].copy()
            with np.errstate(divide="ignore", invalid="ignore"):  # in branches that are not taken
                by_scalar = back(body, 0, bar, *scalars, *((1.0,) if name == "share" else ()))
            wanted, by_scalars = differentiate(body[:, 0], scalars, by)
            scale = 1.0 + np.abs(wanted)
            assert np.max(np.abs(bar[:, 0] - wanted) / scale) < 1e-9
            assert by_scalar == pytest.approx(float(sum(by_scalars)), rel=1e-9)
            checked += 1


@pytest.mark.parametrize("name", ["aim", "drift", "find", "part"])
def test_each_stage_has_the_tangents_that_its_adjoint_has(name: str):
    """b·(J·v) = (Jᵀ·b)·v, the same sums in another order: they differ by at most 10⁵ roundings of
    their largest terms.

    Derivatives of the share of a kick before a change are large where the slip hardly leaves its
    band."""
    stage: Any = {
        "aim": aim,
        "drift": drift,
        "find": STAGES.find,
        "part": stages_in_span(STAGES)[1],
    }[name]
    constants = (True,) if name in ("aim", "drift") else ()
    scalars = ("h",) if name in ("drift", "find") else ()
    rng, active, checked = np.random.default_rng(8), sorted(KICK), 0
    back = adjoint_of(stage, *scalars, constants=constants)
    push = tangent_of(stage, *scalars, constants=constants, active=KICK, lanes=5)
    while checked < 60:
        body = random_body(rng)
        if name == "part":
            STAGES.find(body, 0, SUBSTEP)
            if body[BODY.switches, 0] == 0.0 or not STAGES.share(body, 0) < 1.0:
                continue
        by, v, given = (
            np.zeros((BODY_WIDTH, 1)),
            np.zeros((BODY_WIDTH, 5)),
            (SUBSTEP,) * len(scalars),
        )
        by[active, 0], v[active] = rng.normal(size=len(active)), rng.normal(size=(len(active), 5))
        bar, dot, moved, after = by.copy(), v.copy(), body.copy(), body.copy()
        with np.errstate(divide="ignore", invalid="ignore"):  # in branches that are not taken
            back(body, 0, bar, *given)
            push(moved, 0, dot, *given)
            stage(after, 0, *given, *constants)
        np.testing.assert_array_equal(moved[active], after[active])
        size = np.abs(bar).T @ np.abs(v) + np.abs(by).T @ np.abs(dot)
        assert np.all(np.abs(by.T @ dot - bar.T @ v) <= 1e5 * EPS * size)
        checked += 1


ALL: dict[str, Machine] = {
    "as it is": BASELINE,
    "no stiction": replace(
        BASELINE, clutch=replace(BASELINE.clutch, breakaway=BASELINE.clutch.dynamic)
    ),
    "with a hand": replace(
        BASELINE,
        hand=Hand(mass=0.3, damping=4.0, stiffness=30.0),
        arm=replace(BASELINE.arm, viscous_a=0.1, viscous_b=0.2, dry_a=0.3, dry_b=0.2),
        clutch_scale=(1.1, 0.9, 1.0, 1.2),
    ),
    "lagging voltages": replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage")),
    "other clutches": replace(
        MACHINES["couplings-1-2"], arm=replace(BASELINE.arm, dry_a=0.2, dry_b=0.1)
    ),
}

COVERED = ("as it is", "other clutches")
"""What the others have in them."""

STIFF = replace(
    ALL["with a hand"], hand=Hand(mass=0.3, damping=900.0, damping_anisotropy=(0.3, -0.2))
)
"""With so much damping that more than half of it is implicit."""


@pytest.mark.parametrize("kind", [*ALL, "with a strong damper"])
def test_the_constants_of_a_machine_have_the_derivatives_of_differences(kind: str):
    """Steps of 10⁻⁶ lose 10⁻⁹ to rounding, and less to curvature."""
    machine, bar, rows = ALL.get(kind, STIFF), np.zeros((BODY_WIDTH, 1)), [*flat(BODY.machine)]
    bar[rows, 0] = np.random.default_rng(9).normal(size=len(rows))
    found = by_machine(machine, bar)
    for place, (value, least) in numbers_of(machine).items():
        if place != "substep" and value > least:
            step = 1e-6 * abs(value) or 1e-6
            high, low = (
                np.array(flat(model_of(with_numbers(machine, {place: value + e}))))
                for e in (step, -step)
            )
            difference = bar[rows, 0] @ (high - low) / (2.0 * step)
            assert found[place] == pytest.approx(difference, rel=1e-6, abs=1e-6), place


def drawn(machine: Machine, steps: int, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {
        "machine": machine,
        "state": initial_state(
            machine, (1.9, 0.6), rng.normal(0.0, 0.5, 2), rng.uniform(0.0, 4.0, 4)
        ),
        "volts": rng.uniform(0.5, 12.0, (steps, 4)),
        "hand_force": rng.normal(0.0, 40.0, (steps, 4, 2)),
        "hand_target": rng.normal(0.0, 0.5, 2),
    }


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rollouts run the functions that kernels are compiled from."""

    def plain(**kind: bool) -> tuple[Any, ...]:
        return tuple(getattr(kernel, "py_func", kernel) for kernel in kernels(**kind))

    monkeypatch.setattr(_rollout, "kernels", plain)


@pytest.mark.parametrize("steps", [8, pytest.param(30, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.long if kind in COVERED else ()) for kind in ALL]
)
def test_a_rollout_has_the_gradient_of_paired_rollouts(kind: str, steps: int, uncompiled: None):
    """By all that goes in, over control steps of sticking and slipping in which no pair has another
    order of events.

    Steps of 10⁻⁶ lose 10⁻⁹ of the scalar to rounding, and its curvature takes about as much.
    """
    given = drawn(ALL[kind], steps, seed=3)
    run = gradients.rollout(**given)
    rng = np.random.default_rng(4)
    by = {
        name: rng.normal(size=getattr(run, name).shape)
        for name in vars(run)
        if not name.startswith("_")
    }
    gradient = run.gradient(**by)

    def paired(field: str, change: Callable[[float], Any], step: float = 1e-6) -> float:
        def value(sign: float) -> float:
            other = gradients.rollout(**{**given, field: change(sign * step)})
            return sum(np.sum(by[name] * getattr(other, name)) for name in by)

        return (value(1.0) - value(-1.0)) / (2.0 * step)

    for name in ("volts", "hand_force", "hand_target"):
        z = rng.normal(size=np.shape(given[name]))
        ours = getattr(gradient, name)
        total = np.sum((ours.sum(axis=(0, 1)) if z.shape == (2,) else ours) * z)
        moved = paired(name, lambda e, name=name, z=z: given[name] + e * z)
        assert total == pytest.approx(moved, rel=1e-5, abs=1e-5), name
    # where T_s is T_k, a change of one alone begins or ends the division of kicks
    alone = kind == "no stiction"
    for name in vars(given["state"]):
        if (
            alone and name.startswith("torque")
        ) or name == "heat":  # machines whose clutches fade have no derivatives
            continue
        values = getattr(given["state"], name)
        z = rng.normal(size=values.shape)
        moved = paired(
            "state",
            lambda e, name=name, values=values, z=z: replace(
                given["state"], **{name: values + e * z}
            ),
        )
        assert np.sum(getattr(gradient.state, name) * z) == pytest.approx(
            moved, rel=1e-5, abs=1e-5
        ), name
    for place, (value, _) in numbers_of(ALL[kind]).items():
        if alone and place.startswith(("clutch.breakaway", "clutch.dynamic")):
            continue
        if place not in ("substep", "delay") and not (
            value == 0.0 and place.startswith(("arm", "hand", "clutch"))
        ):
            step = 1e-8 if place == "slip_threshold" else 1e-6
            moved = paired(
                "machine",
                partial(
                    lambda e, place, value: with_numbers(ALL[kind], {place: value + e}),
                    place=place,
                    value=value,
                ),
                step,
            )
            assert gradient.machine[place] == pytest.approx(moved, rel=1e-4, abs=1e-4), place


def test_a_rollout_moves_as_the_simulator_does(uncompiled: None):
    """The same substeps, but that half-drifts between kicks are one: 120 substeps of rounding."""
    given = drawn(BASELINE, 30, seed=5)
    run = gradients.rollout(**given)
    rows = np.repeat(given["volts"], 4, axis=0), given["hand_force"].reshape(-1, 2)
    trajectory = simulate(BASELINE, given["state"], *rows)
    for name in ("theta", "omega", "tip_position", "tip_velocity", "torque_breakaway"):
        np.testing.assert_allclose(
            getattr(run, name)[1:], getattr(trajectory, name)[3::4], rtol=1e-12, atol=1e-12
        )
    again = gradients.rollout(
        **{**given, "state": run.final, "volts": given["volts"][:1], "hand_force": np.ones(2)}
    )
    np.testing.assert_array_equal(again.theta[0], run.theta[-1])


@pytest.mark.long
def test_kernels_compute_what_their_functions_do(request: pytest.FixtureRequest):
    """But for the last bits of hypot: 8 control steps multiply them by less than 10⁶."""
    run = gradients.rollout(**drawn(ALL["with a hand"], 8, seed=3))
    by = {"tip_position": np.ones((9, 2)), "torque_breakaway": np.ones((9, 4))}
    compiled = run.gradient(**by)
    request.getfixturevalue("uncompiled")
    plain = run.gradient(**by)
    for name in ("volts", "hand_force", "hand_target"):
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), 1e-9, 1e-9)
    assert compiled.machine == pytest.approx(plain.machine, rel=1e-9, abs=1e-9)


def parts_of(body: Any) -> int:
    """How many parts a kick from here has."""
    body = body.copy()
    STAGES.whole(body, 1, SUBSTEP)
    return 1 if body[BODY.span, 0] == SUBSTEP else 2


def test_whole_numbers_in_a_machine_are_numbers(uncompiled: None):
    def gradient(machine: Machine) -> gradients.Gradient:
        made = gradients.rollout(
            machine, initial_state(machine, (0.5, 2.0)), np.full((3, 4), 5.0), np.array([5.0, 3.0])
        )
        return made.gradient(tip_position=np.ones((4, 2)))

    once = gradients.rollout(BASELINE, initial_state(BASELINE, (0, 2)), np.full((3, 4), 5), [5, 3])
    again = gradients.rollout(
        BASELINE, initial_state(BASELINE, (0.0, 2.0)), np.full((3, 4), 5.0), [5.0, 3.0]
    )
    np.testing.assert_array_equal(
        once.gradient(theta=np.ones((4, 2), int)).volts, again.gradient(theta=np.ones((4, 2))).volts
    )
    whole = replace(
        BASELINE, clutch=replace(BASELINE.clutch, voltage_max=24), clutch_scale=(1, 1, 1, 1)
    )
    found, expected = gradient(whole), gradient(BASELINE)
    assert found.machine == expected.machine
    np.testing.assert_array_equal(found.volts, expected.volts)


def test_derivatives_hold_on_both_sides_of_each_switch():
    """Between two states of which one divides its kick, bisection finds the switch; 10⁻⁵ either
    side of it the derivative along the line is that of a difference that does not cross it."""
    rng, seen = np.random.default_rng(6), 0
    _, adjoint = kick_adjoints(STAGES)
    rows = [
        BODY.motion.omega_a,
        BODY.motion.omega_b,
        *flat(BODY.torques),
        BODY.load.force_x,
        BODY.load.force_y,
    ]
    while seen < 20:
        body = random_body(rng)
        z = np.zeros((BODY_WIDTH, 1))
        z[rows, 0] = rng.normal(size=len(rows)) * np.array([0.02] * 2 + [0.1] * 8 + [10.0] * 2)
        low, high = 0.0, 1.0
        if parts_of(body) == parts_of(body + z):
            continue
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            low, high = (
                (middle, high) if parts_of(body + middle * z) == parts_of(body) else (low, middle)
            )
        by = rng.normal(size=2)

        def after(t: float, body: Any = body, z: Any = z, by: Any = by) -> float:
            moved = body + t * z
            STAGES.whole(moved, 1, SUBSTEP)
            return float(by @ [moved[BODY.motion.omega_a, 0], moved[BODY.motion.omega_b, 0]])

        for t in (low - 1e-5, high + 1e-5):
            bar = np.zeros((BODY_WIDTH, 1))
            bar[[BODY.motion.omega_a, BODY.motion.omega_b], 0] = by
            with np.errstate(divide="ignore", invalid="ignore"):
                adjoint(body + t * z, 0, bar, SUBSTEP)
            difference = (after(t + 1e-6) - after(t - 1e-6)) / 2e-6
            assert np.sum(bar * z) == pytest.approx(difference, rel=1e-3, abs=1e-6)
        seen += 1


@pytest.mark.long
def test_jax_has_the_same_motion_and_gradient():
    jax = pytest.importorskip("jax")
    from pter_gym.gradients.jax import make_rollout

    given = drawn(ALL["with a hand"], 20, seed=7)
    run = gradients.rollout(**given)
    goal = np.array([0.2, 0.8])
    ours = run.gradient(tip_position=2.0 * (run.tip_position - goal))
    for wide, close in ((True, 1e-12), (False, 1e-3)):
        with jax.enable_x64(wide):
            roll = make_rollout(given.pop("machine", ALL["with a hand"]))

            def cost(volts: Any, force: Any, numbers: Any, roll: Any = roll) -> Any:
                motion = roll(given["state"], volts, force, given["hand_target"], numbers)
                return jax.numpy.sum((motion.tip_position - goal) ** 2)

            numbers = {
                "clutch.time_constant": BASELINE.clutch.time_constant,
                "arm.length_a": BASELINE.arm.length_a,
            }
            inputs = (
                jax.numpy.asarray(given["volts"]),
                jax.numpy.asarray(given["hand_force"]),
                numbers,
            )
            value, found = jax.jit(jax.value_and_grad(cost, (0, 1, 2)))(*inputs)
            assert float(value) == pytest.approx(np.sum((run.tip_position - goal) ** 2), rel=close)
            np.testing.assert_allclose(
                found[0], ours.volts, rtol=close, atol=close * np.abs(ours.volts).max()
            )
            np.testing.assert_allclose(
                found[1], ours.hand_force, rtol=close, atol=close * np.abs(ours.hand_force).max()
            )
            for place, by in found[2].items():
                assert float(by) == pytest.approx(ours.machine[place], rel=close)
            each = jax.numpy.stack([inputs[0], 0.5 * inputs[0]])
            many = jax.vmap(jax.grad(cost), in_axes=(0, None, None))(each, *inputs[1:])
            np.testing.assert_array_equal(many[1], jax.grad(cost)(each[1], *inputs[1:]))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("volts", np.full((3, 4), 25.0)),
        ("volts", np.ones(4)),
        ("volts", np.full((3, 4), np.nan)),
        ("hand_force", np.ones((2, 2))),
        ("period", 0.0),
        ("machine", "no such"),
    ],
)
def test_bad_input_is_refused(field: str, value: Any):
    with pytest.raises(ParameterError, match=field):
        gradients.rollout(**{**drawn(BASELINE, 3, seed=0), "hand_force": np.zeros(2), field: value})


@pytest.mark.parametrize("changes", [{"fade": 0.1}, {"hysteresis": 1.0}, {"band": "printed"}])
def test_clutches_without_derivatives_are_refused(changes: dict[str, Any]):
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, **changes))
    with pytest.raises(ParameterError, match="derivatives"):
        gradients.rollout(**{**drawn(BASELINE, 3, seed=0), "machine": machine})


def test_bad_derivatives_are_refused(uncompiled: None):
    run = gradients.rollout(**drawn(BASELINE, 3, seed=0))
    for field, value in (("tip", np.ones((4, 2))), ("theta", np.ones(2))):
        with pytest.raises(ParameterError, match=field):
            run.gradient(**{field: value})


@pytest.mark.long
def test_second_derivatives_are_refused() -> None:
    jax = pytest.importorskip("jax")
    from pter_gym.gradients.jax import make_rollout

    roll, state = make_rollout(), initial_state(BASELINE, (0.5, 2.0))

    def reached(force: Any) -> Any:
        return roll(state, np.full((3, 4), 5), force).tip_position[-1, 0]

    with pytest.raises(ParameterError, match="derivatives"):
        jax.hessian(reached)(jax.numpy.ones(2))


def test_a_diverging_motion_raises(uncompiled: None):
    given = drawn(BASELINE, 3, seed=0)
    fast = replace(given["state"], omega=np.array([1e200, 1e200]))
    with pytest.raises(DivergenceError):
        gradients.rollout(**{**given, "state": fast})


def test_where_the_torques_are_settled_the_derivative_is_that_of_rising_ones(uncompiled: None):
    """At a constant voltage the lag has a kink where a fall takes longer than a rise.

    The gradient is the limit at voltages that slowly rise, so that of a shift of all steps is the
    forward difference, and that of one step, after which the torque falls, is on neither side.
    """
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, fall_ratio=2.0))
    volts, push = np.tile((6.0, 0.0, 3.0, 0.0), (40, 1)), np.array((40.0, 0.0))
    state = initial_state(machine, (1.9, 0.6), (0.8, -0.3), volts[0])

    def gradient(volts):
        run = gradients.rollout(machine, state, volts, push)
        last = np.zeros_like(run.tip_position)
        last[-1, 0] = 1.0
        return run.gradient(tip_position=last).volts

    def slope(direction, step):
        moved = (volts + step * direction, volts)
        after, before = (
            gradients.rollout(machine, state, each, push).tip_position[-1, 0] for each in moved
        )
        return (after - before) / step

    settled = gradient(volts)
    rising = volts + 1e-9 * np.arange(1.0, 41.0)[:, None]
    np.testing.assert_allclose(settled, gradient(rising), rtol=1e-5, atol=1e-9)
    every, one = np.zeros((2, 40, 4))
    every[:, 0], one[10, 0] = 1.0, 1.0
    forward, backward = slope(every, 1e-6), slope(every, -1e-6)
    assert (settled * every).sum() == pytest.approx(forward, rel=1e-4)
    assert backward != pytest.approx(forward, rel=0.02)
    sides = sorted((slope(one, 1e-6), slope(one, -1e-6)))
    assert sides[0] < (settled * one).sum() < sides[1]
