"""Calibration: find plausible values for what the paper does not print, from its Table I and its trends.

Every candidate obeys the rules of the search space by construction; requirements that cannot be built in become
penalties. The trends of Figs. 7, 8 and 10 are fitted too, so meeting them is no evidence.
"""

from pter_gym.tools.paper.experiments.calibration.objective import TARGET, Quality, misfit, quality_of
from pter_gym.tools.paper.experiments.calibration.readings import READINGS, Reading, setup_of, table_of
from pter_gym.tools.paper.experiments.calibration.search import BUDGET, Calibration, fit
from pter_gym.tools.paper.experiments.calibration.simulation import Case, RunScores, run_cases
from pter_gym.tools.paper.experiments.calibration.space import HAND_MAX, SPACE, Free, decode

__all__ = [
    "BUDGET",
    "HAND_MAX",
    "READINGS",
    "SPACE",
    "TARGET",
    "Calibration",
    "Case",
    "Free",
    "Quality",
    "Reading",
    "RunScores",
    "decode",
    "fit",
    "misfit",
    "quality_of",
    "run_cases",
    "setup_of",
    "table_of",
]
