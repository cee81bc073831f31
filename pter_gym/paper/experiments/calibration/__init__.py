"""Find plausible values for what the paper does not print, from its Table I and its trends: a calibration.

Every candidate obeys the rules of the search space by construction; what cannot be built in costs a penalty. The trends
of Figs. 7, 8 and 10 have weights of their own: with a weight they are fitted, and their holding is no evidence.
"""

from pter_gym.paper.experiments.calibration.objective import TABLE_ONLY, TARGET, Weights, misfit, tables_of
from pter_gym.paper.experiments.calibration.readings import READINGS, Reading, setup_of, table_of
from pter_gym.paper.experiments.calibration.search import Fit, FitArguments, fit
from pter_gym.paper.experiments.calibration.simulation import Case, Outcome, at, run_cases
from pter_gym.paper.experiments.calibration.space import HAND_MAX, SPACE, Free, decode

__all__ = [
    "HAND_MAX",
    "READINGS",
    "SPACE",
    "TABLE_ONLY",
    "TARGET",
    "Case",
    "Fit",
    "FitArguments",
    "Free",
    "Outcome",
    "Reading",
    "Weights",
    "at",
    "decode",
    "fit",
    "misfit",
    "run_cases",
    "setup_of",
    "table_of",
    "tables_of",
]
