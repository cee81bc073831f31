"""From a Machine to the record of constants that the kernels read."""

from typing import Annotated, NamedTuple

from pter_gym._compiled.records import Entry
from pter_gym._physics.arm import Deviator, Linkage
from pter_gym._physics.arrangement import Arrangement, OptionalArrangement
from pter_gym._physics.clutch import Curve, Decay, PerClutch, Sliding, lag_left
from pter_gym.params import SLOTS, Hand, Machine, TorqueCurve as CurveParameters
from pter_gym.params._machine import BRAKE_A, BRAKE_B, tip_mass

NO_LAG = Decay(0.0, 0.0)


class Model(NamedTuple):
    """Constants of one machine as the kernels see them."""

    arm: Linkage
    breakaway: Annotated[Curve, Entry("", "breakaway torque")]
    dynamic: Annotated[Curve, Entry("", "dynamic torque")]
    sliding: Sliding
    voltage_decay: Annotated[Decay, Entry("1", "{} voltage", name="voltage_decay")]
    torque_decay: Annotated[Decay, Entry("1", "{} torque", name="torque_decay")]
    hysteresis: Annotated[float, Entry("V", "half the width of the loop of torque over voltage")]
    fade: Annotated[float, Entry("1/J", "torque lost with the heat of a clutch")]
    cooling: Annotated[float, Entry("s", "time constant with which a clutch cools")]
    voltage_max: Annotated[float, Entry("V", "largest voltage")]
    slip_threshold: Annotated[float, Entry("rad/s", "stick band δω")]
    scale: Annotated[PerClutch, Entry("1", "torque, relative to that of the curves")]


def model_of(machine: Machine) -> Model:
    """Return the constants of a machine; the mass of the hand goes into the arm exactly."""
    arm = machine.arm
    hand = machine.hand
    clutch = machine.clutch
    half = 0.5 * machine.substep
    decay = Decay(
        lag_left(half, clutch.time_constant),
        lag_left(half, clutch.time_constant * clutch.fall_ratio),
    )
    lags_voltage = clutch.lag == "voltage"
    return Model(
        arm=Linkage(
            length_a=arm.length_a,
            length_b=arm.length_b,
            m11=arm.inertia_a + hand.mass * arm.length_a**2,
            m22=arm.inertia_b + hand.mass * arm.length_b**2,
            coupling=arm.coupling + hand.mass * arm.length_a * arm.length_b,
            damping=hand.damping,
            stiffness=hand.stiffness,
            implicit=implicit_share(machine),
            dry_a=arm.dry_a,
            dry_b=arm.dry_b,
            viscous_a=arm.viscous_a,
            viscous_b=arm.viscous_b,
            damping_by=deviator_of(hand.damping, hand.damping_anisotropy),
            stiffness_by=deviator_of(hand.stiffness, hand.stiffness_anisotropy),
        ),
        breakaway=curve_of(clutch.breakaway),
        dynamic=curve_of(clutch.dynamic),
        sliding=Sliding(
            clutch.stribeck * clutch.stribeck,
            PerClutch(*(clutch.viscous * scale for scale in machine.slot_scale)),
            1.0 if clutch.band == "printed" else 0.0,
        ),
        voltage_decay=decay if lags_voltage else NO_LAG,
        torque_decay=NO_LAG if lags_voltage else decay,
        hysteresis=clutch.hysteresis,
        fade=clutch.fade,
        cooling=clutch.cooling,
        voltage_max=clutch.voltage_max,
        slip_threshold=machine.slip_threshold,
        scale=PerClutch(*machine.slot_scale),
    )


def deviator_of(mean: float, anisotropy: tuple[float, ...]) -> Deviator:
    """Return the deviator of a matrix, from its mean over all directions and its anisotropy."""
    stretch, shear = anisotropy
    return Deviator(mean * stretch, mean * shear)


def arrangement_of(machine: Machine) -> Arrangement:
    """Return W of a machine; an axis's dry friction is with the first slot of its slip."""
    rows, dry = machine.slot_rows, [0.0] * SLOTS
    for brake, friction in ((BRAKE_A, machine.arm.dry_a), (BRAKE_B, machine.arm.dry_b)):
        if friction > 0.0:
            dry[rows.index(brake.row)] = friction
    a, b = zip(*rows, strict=True)
    number = 0.0 if machine.has_paper_clutches else float(len(machine.clutches))
    return Arrangement(PerClutch(*a), PerClutch(*b), PerClutch(*dry), number)


def optional_arrangement(machine: Machine) -> OptionalArrangement:
    """Return W of a machine as functions of friction take it: None for the paper's."""
    return None if machine.has_paper_clutches else arrangement_of(machine)


def implicit_share(machine: Machine) -> float:
    """Return the share of the hand's damping that must be implicit.

    Half of it, for second order, or more where a substep takes so much of the motion that its sign
    would alternate: the share before a kick takes at most all of it.
    """
    taken = machine.substep * max_damping(machine.hand)
    return 1.0 - min(0.5, tip_mass(machine.arm) / taken) if taken > 0.0 else 0.5


def max_damping(hand: Hand) -> float:
    """Return an upper bound of a hand's damping in any direction [N·s/m]."""
    stretch, shear = hand.damping_anisotropy
    return hand.damping * (1.0 + abs(stretch) + abs(shear))


def curve_of(curve: CurveParameters) -> Curve:
    """Return a torque curve as the kernels see it."""
    return Curve(curve.slope, curve.knee, curve.curvature, curve.off_state)
