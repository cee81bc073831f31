"""Guiding controllers: a damper along the path, a torque table, and gains that may follow the pace.

``Impedance`` and ``TorqueFeedback`` are the paper's (sections III-A and IV-B.3, Fig. 6).
``SingleDof`` and ``VelocityRatio`` follow later work on PTER in their ideas: Swanson and Book,
"Path-following control for dissipative passive haptic displays", Symposium on Haptic Interfaces
2003, and Swanson's dissertation, Georgia Institute of Technology 2003. Their laws and gains are
chosen here; none of those works' results is reproduced.
"""

from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar

from pter_gym._compiled.layout import Layout
from pter_gym._internal.fields import (
    parameter,
    require,
    require_flag,
    require_number,
    require_numbers,
    types_of,
)
from pter_gym.controllers._allocation import unsteered
from pter_gym.controllers._gains import gain_parts, gain_record
from pter_gym.controllers._laws import Law, declared_clutches, guiding_law, paper_clutches
from pter_gym.controllers._policy import Policy
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, find_machine
from pter_gym.tasks.path_following._observation import OBS

Search = dict[str, tuple[float, float] | tuple[bool, bool]]
"""Ranges by the names of gains: (low, high), logarithmic where low > 0, or (False, True)."""

LOOP: Search = {"feedback": (0.01, 5.0), "hold_when_stuck": (False, True)}


@dataclass(frozen=True, kw_only=True)
class Guided:
    """A controller that computes a tip force, clutch torques for it, and their voltages.

    The controller knows the nominal machine that it is bound to: its link lengths and inertias, and
    the dynamic torque curve at ``table_volts``. Between these it interpolates, so its table is not
    the plant's curve. Below 4 V, where the paper could not measure, the table is extrapolated to (0
    V, 0 N·m). It ends at the largest voltage, which replaces all knots from there on.

    Voltages, here and in ``feedback``, refer to PTER's 24 V drive and scale with the machine's
    largest voltage, so a law doesn't depend on the unit of a device's drive.
    """

    damping_tangential: float = parameter("N·s/m", "fitted: damper along the path", default=106.4)
    pace_fraction: float = parameter(
        "1",
        "chosen: fraction of the pace below which the damper along the path does nothing; paper: 0",
        default=0.0,
    )
    pace_integral: float = parameter(
        "N·s/m",
        "chosen: braking force that a control step adds for each m/s above the pace; paper: 0",
        default=0.0,
    )
    grip: float = parameter(
        "1",
        "chosen: control steps at the start with all clutches fully engaged; paper: 0",
        default=0.0,
    )
    table_volts: tuple[float, ...] = parameter(
        "V", "chosen: five knots; 4 V published", default=(0.0, 4.0, 10.0, 17.0, 24.0)
    )
    slip_threshold: float = parameter(
        "rad/s", "fitted: a slower clutch counts as stuck", default=0.005983
    )

    steering: ClassVar[Any] = unsteered
    """Compiled function that makes clutch torques of the desired joint torques.

    ``steering(g, tip, nominal, want, memory, arrangement) -> PerClutch``
    """

    search: ClassVar[Search] = {
        "braking": (10.0, 300.0),
        "pace_fraction": (0.0, 0.95),
        "pace_integral": (0.05, 30.0),
        "grip": (0.0, 30.0),
        "slip_threshold": (1e-3, 0.2),
    }
    """Ranges of the gains in SI, as ``pter tune`` reads them.

    ``braking`` stands for the damper along the path: the force [N] with which it holds the hand
    back at the commanded pace. It has to balance the hand's push whatever the other gains are.
    """

    needs: ClassVar[dict[str, str]] = {}
    """By the names of gains, entries of the observation that they multiply.

    ``pter tune`` leaves a gain out where that entry is 0 in all episodes.
    """

    ranges: ClassVar[dict[str, dict[str, float]]] = {
        "pace_fraction": {"at_least": 0.0, "at_most": 1.0}
    }
    """What the gains accept that are not merely ≥ 0."""

    def __post_init__(self) -> None:
        """Check gains and table."""
        types = types_of(type(self))
        for item in fields(self):
            if types[item.name] is bool:
                require_flag(self, item.name)
            elif types[item.name] is float:
                require_number(self, item.name, **self.ranges.get(item.name, {"at_least": 0.0}))
        require_numbers(self, "table_volts")
        rising = self.table_volts[:1] == (0.0,) and all(
            a < b for a, b in pairwise(self.table_volts)
        )
        require(rising, self, "table_volts", "a tuple of rising voltages from 0")

    def gains(self) -> Any:
        """Return the gains as the law reads them: a record of ``Gains``, and those it adds."""
        types = types_of(type(self))
        names = tuple(item.name for item in fields(self) if types[item.name] in (bool, float))
        record = gain_record(names)
        missing = dict.fromkeys(record._fields, 0.0)
        return record(**missing | {name: float(getattr(self, name)) for name in names})

    def at(self, pace: float) -> "Guided":  # noqa: ARG002
        """Return itself: its gains are the same at all paces [m/s]; see ``PaceSchedule.at``."""
        return self

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine.

        Raises
        ------
        ParameterError
            If the table does not end at the machine's largest voltage, or there is a torque loop
            and the observation has no torque sensors.
        """
        policy = bind_rows(self, [(1.0, self.gains())], machine, layout)
        return replace(policy, made=partial(self.bind, machine, layout))


@dataclass(frozen=True, kw_only=True)
class Impedance(Guided):
    """Spring and damper normal to the path, damper along it; allocation; torque table."""

    search = Guided.search | {
        "stiffness": (50.0, 20_000.0),
        "damping_normal": (5.0, 3000.0),
        "tip_space": (False, True),
    }

    stiffness: float = parameter("N/m", "fitted: spring normal to the path", default=640.6)
    damping_normal: float = parameter("N·s/m", "fitted: damper normal to the path", default=135.6)
    tip_space: bool = parameter(
        "1", "chosen: allocate for tip force, not joint torque", default=False
    )


@dataclass(frozen=True, kw_only=True)
class TorqueFeedback(Impedance):
    """The impedance controller with a proportional torque loop around each clutch (Fig. 6)."""

    search = Impedance.search | LOOP

    feedback: float = parameter(
        "V/(N·m)",
        "published: Kp = 0.06 (section IV-C.3), read as V per in·lbf",
        default=0.5310447474796312,
    )
    hold_when_stuck: bool = parameter(
        "1", "chosen: switch the loop off where it has no effect", default=False
    )


@dataclass(frozen=True)
class PaceSchedule:
    """One controller for all paces: gains piecewise linear in the commanded pace.

    Below the first pace and above the last, the gains of that knot apply. Boolean gains are those
    of the nearer knot.

    Attributes
    ----------
    knots
        Commanded pace [m/s] and controller, by rising pace. The controllers are of one kind with
        one torque table.
    hold
        A knot's gains hold exactly for paces within this fraction of its own. An observed pace is a
        float32, which is rarely the exact pace of a knot.
    """

    knots: tuple[tuple[float, Guided], ...]
    hold: float = 0.0

    def __post_init__(self) -> None:
        """Check that the knots rise in pace and match in kind."""
        accepted = "pairs of a pace > 0 and a guiding controller, by rising pace"
        knots = self.knots
        pairs: Any = knots
        are_knots = isinstance(pairs, tuple) and len(knots) > 0 and all(map(_is_knot, knots))
        require(are_knots, self, "knots", accepted)
        require(all(a < b for (a, _), (b, _) in pairwise(knots)), self, "knots", accepted)
        alike = {(type(controller), controller.table_volts) for _, controller in knots}
        require(len(alike) == 1, self, "knots", "controllers of one kind with one table_volts")
        require_number(self, "hold", at_least=0.0, below=1.0)
        apart = all(
            a * (1.0 + self.hold) < b * (1.0 - self.hold) for (a, _), (b, _) in pairwise(knots)
        )
        require(apart, self, "hold", "small enough to leave room between the knots")

    def at(self, pace: float) -> Guided:
        """Return the controller of the knot at a commanded pace [m/s].

        Raises
        ------
        ParameterError
            If there is no knot at that pace; the message lists the paces that have one.
        """
        laws = dict(self.knots)
        if pace not in laws:
            raise ParameterError(
                f"pace must be one of {', '.join(f'{knot:g}' for knot in laws)} m/s, got {pace!r}"
            )
        return laws[pace]

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine; raises like the controllers' own ``bind``."""
        edges = (1.0 - self.hold, 1.0 + self.hold) if self.hold else (1.0,)
        rows = [
            (pace * edge, controller.gains()) for pace, controller in self.knots for edge in edges
        ]
        policy = bind_rows(self.knots[0][1], rows, machine, layout)
        return replace(policy, made=partial(self.bind, machine, layout))


def _is_knot(knot: object) -> bool:
    """Return whether this is a pair of a finite pace > 0 and a guiding controller."""
    match knot:
        case (int() | float() as pace, Guided()):
            return 0.0 < pace < float("inf")
        case _:
            return False


def bind_rows(
    first: Guided, rows: list[tuple[float, Any]], machine: Machine, layout: Layout
) -> Policy:
    """Return the policy for rows of gains by pace, with the first controller's law and table."""
    machine = find_machine(machine)
    top, usual = machine.clutch.voltage_max, BASELINE.clutch.voltage_max
    volts = (*(knot * (top / usual) for knot in first.table_volts if knot < usual), top)
    rows = [(pace, gains._replace(feedback=gains.feedback * (top / usual))) for pace, gains in rows]
    feeds_back = any(gains.feedback != 0.0 for _, gains in rows)
    if feeds_back and ("torque_1" not in layout.names or layout.index("torque_1") != OBS.torque.x1):
        raise ParameterError(
            'torque feedback needs torque sensors: sensors="torque" or sensors="force"'
        )
    return Policy.from_law(
        law_of(first, machine), gain_parts(machine, volts, rows), machine, layout
    )


def law_of(controller: Guided, machine: Machine) -> Law:
    """Return the compiled law of a controller for a machine's clutches."""
    arrangement_at = paper_clutches if machine.has_paper_clutches else declared_clutches
    record: type[Any] = controller.gains().__class__
    return guiding_law(type(controller).steering, record, arrangement_at)
