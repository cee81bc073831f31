"""All statements, and the check of each against the experiments of a study."""

from collections.abc import Iterable

from pter_gym.paper.experiments.claims.clutch import CLUTCH
from pter_gym.paper.experiments.claims.feedback import FEEDBACK
from pter_gym.paper.experiments.claims.materials import MATERIALS
from pter_gym.paper.experiments.claims.path_following import PATH_FOLLOWING
from pter_gym.paper.experiments.claims.reversals import REVERSALS
from pter_gym.paper.experiments.claims.statement import Claim, Statement
from pter_gym.paper.experiments.study import Study

STATEMENTS = CLUTCH + MATERIALS + PATH_FOLLOWING + REVERSALS + FEEDBACK
"""Every sentence that can be checked, in the order of the paper."""


def check(study: Study, statements: Iterable[Statement] | None = None) -> tuple[Claim, ...]:
    """Check statements, by default all of them, against the experiments of a study of Table I's three machines."""
    return tuple(_check(study, statement) for statement in (STATEMENTS if statements is None else statements))


def _check(study: Study, statement: Statement) -> Claim:
    value = float(statement.measure(study))
    return Claim(statement, value, bool(statement.at_least <= value <= statement.at_most))
