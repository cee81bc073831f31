"""Every sentence of the paper that can be checked, with what we measure and what would make it hold.

``STATEMENTS`` is the one place for thresholds. Three words are used with care: a claim that holds is *calibrated* where
a number was fitted to it or put into the model, and *reproduced* only where it was not; otherwise it is *not met*.
"""

from pter_gym.paper.experiments.claims.checking import STATEMENTS, check
from pter_gym.paper.experiments.claims.statement import COLUMNS, NAMES, TABLE_TOLERANCE, Claim, Kind, Statement

__all__ = ["COLUMNS", "NAMES", "STATEMENTS", "TABLE_TOLERANCE", "Claim", "Kind", "Statement", "check"]
