from ._observation import OBS as OBS, Sensors as Sensors, observation_layout as observation_layout
from ._reward import RewardWeights as RewardWeights
from ._specification import (
    AT_REST as AT_REST,
    IDEAL_SENSING as IDEAL_SENSING,
    MAX_DELAY as MAX_DELAY,
    STARTS as STARTS,
    PathFollowing as PathFollowing,
    Sensing as Sensing,
    Starts as Starts,
    check_machine as check_machine,
    find_starts as find_starts,
    substeps as substeps,
)
from ._telemetry import (
    COLUMN as COLUMN,
    TELEMETRY as TELEMETRY,
    Reason as Reason,
    reason_of as reason_of,
)
