"""Every sentence of the paper that can be checked, with what we measure and what would make it hold.

``STATEMENTS`` is the one place for thresholds. Three words are used with care: a claim that holds is *calibrated* where
a number was fitted to it or put into the model, and *reproduced* only where it was not; otherwise it is *not met*.
"""

from collections.abc import Iterable

from pter_gym.paper.experiments.claims.clutch import CLUTCH
from pter_gym.paper.experiments.claims.feedback import FEEDBACK
from pter_gym.paper.experiments.claims.materials import MATERIALS
from pter_gym.paper.experiments.claims.path_following import PATH_FOLLOWING
from pter_gym.paper.experiments.claims.reversals import REVERSALS
from pter_gym.paper.experiments.claims.statement import COLUMNS, NAMES, TABLE_TOLERANCE, Claim, Kind, Statement
from pter_gym.paper.experiments.study import Study

__all__ = ["COLUMNS", "NAMES", "STATEMENTS", "TABLE_TOLERANCE", "Claim", "Kind", "Statement", "check"]

STATEMENTS = CLUTCH + MATERIALS + PATH_FOLLOWING + REVERSALS + FEEDBACK
"""Every sentence that can be checked, in the order of the paper."""


def check(study: Study, statements: Iterable[Statement] | None = None) -> tuple[Claim, ...]:
    """Check statements, by default all of them, against the experiments of a study of Table I's three machines."""
    return tuple(_check(study, statement) for statement in (STATEMENTS if statements is None else statements))


def _check(study: Study, statement: Statement) -> Claim:
    value = float(statement.measure(study))
    return Claim(statement, value, bool(statement.at_least <= value <= statement.at_most))
