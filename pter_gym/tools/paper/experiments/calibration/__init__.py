"""Find plausible values for what the paper does not print, from its Table I and its trends: a calibration.

Every candidate obeys the rules of the search space by construction; what cannot be built in costs a penalty. The trends
of Figs. 7, 8 and 10 are fitted too, so their holding is no evidence, unless a search holds them out.
"""

from pter_gym.tools.paper.experiments.calibration.objective import TARGET, misfit, tables_of
from pter_gym.tools.paper.experiments.calibration.readings import READINGS, Reading, setup_of, table_of
from pter_gym.tools.paper.experiments.calibration.search import BUDGET, POPULATION, Calibration, fit
from pter_gym.tools.paper.experiments.calibration.simulation import Case, RunScores, at, run_cases
from pter_gym.tools.paper.experiments.calibration.space import HAND_MAX, SPACE, Free, decode

__all__ = [
    "BUDGET",
    "HAND_MAX",
    "POPULATION",
    "READINGS",
    "SPACE",
    "TARGET",
    "Calibration",
    "Case",
    "Free",
    "Reading",
    "RunScores",
    "at",
    "decode",
    "fit",
    "misfit",
    "run_cases",
    "setup_of",
    "table_of",
    "tables_of",
]
