"""What the clutches of a machine connect."""

from dataclasses import dataclass

from pter_gym._internal.fields import Checked, parameter, require


@dataclass(frozen=True)
class Connection(Checked):
    """The name of a clutch and its row (a, b) of W [1].

    It slips at a·ω_A + b·ω_B, and its torque τ acts as a·τ on link A and b·τ on link B. (1, 0) and
    (0, 1) are brakes; (1, −r) couples axis A to axis B, and (1, r) does so through an inverting
    gear, for 0.01 ≤ r ≤ 100. Other rows raise a ParameterError.
    """

    name: str = parameter("1", "chosen")
    row: tuple[float, float] = parameter(
        "1", "published: Eqs. 3 and 4, for PTER's clutches", count=2
    )

    def __post_init__(self) -> None:
        """Check both."""
        super().__post_init__()
        require(
            self.name.isprintable() and 0 < len(self.name) <= 40, self, "name", "1 to 40 characters"
        )
        accepted = "(0, 1), (1, 0), (1, −r) or (1, r) with 0.01 ≤ r ≤ 100"
        a, b = self.row
        fits = (a, b) == (0.0, 1.0) or (a == 1.0 and (b == 0.0 or 0.01 <= abs(b) <= 100.0))
        require(fits, self, "row", accepted)
        object.__setattr__(self, "row", (float(a), float(b)))


BRAKE_A, BRAKE_B = Connection("A to ground", (1.0, 0.0)), Connection("B to ground", (0.0, 1.0))
COUPLED, INVERTED = Connection("A to B", (1.0, -1.0)), Connection("A to B, inverted", (1.0, 1.0))

PAPER_CLUTCHES = (BRAKE_A, BRAKE_B, COUPLED, INVERTED)
"""The clutches of PTER (paper Eqs. 3 and 4)."""

SLOTS = len(PAPER_CLUTCHES)
"""Most clutches of a machine: voltages, torques and slips are always so many."""
