"""Follow a path while a hand pushes along it and disturbs across it (paper section IV-A).

What a user states is in ``_specification``, and the numbers that kernels make of it in
``_context`` and ``_model``. ``_position`` says where the tip is, ``_reward`` what that is worth,
``_ending`` when an episode is over, ``_observation`` what is seen, ``_telemetry`` what is recorded.
"""

from pter_gym.tasks.path_following._observation import OBS, Sensors, observation_layout
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
    find_starts,
    substeps,
)
from pter_gym.tasks.path_following._telemetry import COLUMN, TELEMETRY, Reason, reason_of

__all__ = [
    "AT_REST",
    "COLUMN",
    "IDEAL_SENSING",
    "MAX_DELAY",
    "OBS",
    "STARTS",
    "TELEMETRY",
    "PathFollowing",
    "Reason",
    "RewardWeights",
    "Sensing",
    "Sensors",
    "Starts",
    "check_machine",
    "find_starts",
    "observation_layout",
    "reason_of",
    "substeps",
]
