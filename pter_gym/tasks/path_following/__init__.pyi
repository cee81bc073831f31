from ._observation import OBS as OBS, Sensors as Sensors, observation_layout as observation_layout
from ._reward import RewardWeights as RewardWeights
from ._specification import (
    AT_REST as AT_REST,
    STARTS as STARTS,
    Failure as Failure,
    PathFollowing as PathFollowing,
    Sensing as Sensing,
    Starts as Starts,
    check_machine as check_machine,
)
from ._telemetry import (
    COLUMN as COLUMN,
    TELEMETRY as TELEMETRY,
    Reason as Reason,
    reason_of as reason_of,
)
