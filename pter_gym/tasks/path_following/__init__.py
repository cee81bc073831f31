"""Follow a path while a hand pushes along it and disturbs across it (paper section IV-A).

One file each: the task as stated by the user (``specification``), the agent's ``observation`` and ``reward``, the
recorded ``telemetry``, the constants behind them (``context``), and a world's position relative to its path
(``situation``).
"""

from pter_gym.tasks.path_following._ending import Reason, reason_of
from pter_gym.tasks.path_following._observation import SEEN, Sensors, observation_layout
from pter_gym.tasks.path_following._reward import RewardWeights
from pter_gym.tasks.path_following._specification import (
    AT_REST,
    IDEAL_SENSING,
    MAX_DELAY,
    STARTS,
    PathFollowing,
    Sensing,
    Starts,
    check_machine,
    substeps,
)
from pter_gym.tasks.path_following._telemetry import COLUMN, TELEMETRY

__all__ = [
    "AT_REST",
    "COLUMN",
    "IDEAL_SENSING",
    "MAX_DELAY",
    "SEEN",
    "STARTS",
    "TELEMETRY",
    "PathFollowing",
    "Reason",
    "RewardWeights",
    "Sensing",
    "Sensors",
    "Starts",
    "check_machine",
    "observation_layout",
    "reason_of",
    "substeps",
]
