"""In words: why a log does not show a number, and which experiment would."""

from types import MappingProxyType

from pter_gym.tools.identification import parameters as at

NO_FORCES = "without forces only ratios can be known: all inertias and torques are relative to this one"
NO_FORCES_RATIO = "without forces nothing tells what load a clutch held"
NO_BREAKAWAY = "no clutch that held was made to slip"
NEVER_SLIPPED = "clutch {} was never on while it slipped"
NO_CLUTCH = "no clutch was on while it slipped"
STRAIGHT = "the torque is straight up to {:.3g} V, the highest voltage at which a clutch slipped"
NO_JUMP = "the clutches break away without a jump: T_s is at most T_k, and then cannot be seen"

TOGETHER = "; these changes together leave the motion as it is: {}"
NO_STEPS = "V1 to V4 never change"
UNMOVED = "the log shows none of the numbers from which it follows"
FEW_LEVELS = "clutches slipped at fewer than three voltages"
ONE_ABOVE = "clutches slipped at one voltage above the knee only: several knees fit, and this is one"

_UNSEEN = {
    at.INERTIA_A: "the log hardly shows the inertia of link A",
    at.INERTIA_B: "the log hardly shows the inertia of link B",
    at.COUPLING: "the log hardly shows the coupling of the axes",
    **{place: f"the log hardly shows the torque of clutch {x}" for x, place in enumerate(at.SLOPES, 1)},
    at.RATIO: "clutches hardly broke away with a jump that the log shows",
    at.TIME_CONSTANT: "no voltage was stepped while a clutch slipped",
    at.DELAY: "no voltage was stepped while a clutch slipped, or the rows are too coarse",
    **dict.fromkeys((*at.DRY, *at.VISCOUS), "the log hardly shows the friction of this axis"),
}

OWNERS = MappingProxyType(
    {
        "inertia_a": at.INERTIA_A,
        "inertia_b": at.INERTIA_B,
        "coupling": at.COUPLING,
        **{f"scale_{x}": place for x, place in enumerate(at.SLOPES, 1)},
        "knee": at.KNEE,
        "curvature": at.EXTRA,
        "breakaway_ratio": at.RATIO,
        "time_constant": at.TIME_CONSTANT,
        "delay": at.DELAY,
        **dict(zip(("dry_a", "dry_b", "viscous_a", "viscous_b"), (*at.DRY, *at.VISCOUS), strict=True)),
    }
)
"""The coordinate without which a number is not known."""

NAMES = MappingProxyType({place: name for name, place in OWNERS.items()})
"""The number that a coordinate is for."""

SCALED = (
    *("inertia_b", "coupling", "torque_25", "torque_50", "torque_75", "torque_100", "slope", "curvature"),
    *("dry_a", "dry_b", "viscous_a", "viscous_b"),
)
"""Numbers that are proportional to the inertia of link A where no force is known."""

_REMEDIES = {
    "inertia": "move the handle faster to and fro with all clutches off, and record the forces",
    "coupling": "move both links at once, with all clutches off, in directions that change",
    "torque": "let each clutch slip at each voltage, one clutch at a time",
    "slope": "let each clutch slip at each voltage, one clutch at a time",
    "scale": "let this clutch slip while it alone is on",
    "knee": "let a clutch slip at several voltages, up to the highest at which you can still pull it",
    "curvature": "let a clutch slip at several voltages, up to the highest at which you can still pull it",
    "breakaway": "hold still with a clutch on, then pull harder until it gives, and repeat; record the forces",
    "time": "switch each clutch on and off while it slips",
    "dry": "let the arm turn slowly and fast with all clutches off, and record the forces",
    "viscous": "let the arm turn slowly and fast with all clutches off, and record the forces",
    "delay": "switch each clutch on and off while it slips; record at least 200 rows per second",
}


def remedy(name: str) -> str:
    """Return which experiment would show a number."""
    return _REMEDIES[name.partition("_")[0]]


def unseen(place: int, value: float, before: float) -> tuple[str, float]:
    """Return why a coordinate is not seen, and the value that it keeps."""
    if place == at.RATIO and value <= 1.03:
        return NO_JUMP, min(before, 1.0)
    if place == at.KNEE:
        return ONE_ABOVE, value
    return _UNSEEN[place], before
