from . import (
    benchmark as benchmark,
    controllers as controllers,
    envs as envs,
    gradients as gradients,
    hands as hands,
    haptics as haptics,
    params as params,
    paths as paths,
    policies as policies,
    scenarios as scenarios,
    tasks as tasks,
)
from ._physics.open_loop import (
    State as State,
    Trajectory as Trajectory,
    initial_state as initial_state,
    simulate as simulate,
)
from ._version import __version__ as __version__
from .params import (
    BASELINE as BASELINE,
    DELRIN_EXPERIMENTAL as DELRIN_EXPERIMENTAL,
    DELRIN_THEORETICAL as DELRIN_THEORETICAL,
    Arm as Arm,
    Clutch as Clutch,
    Hand as Hand,
    Machine as Machine,
    TorqueCurve as TorqueCurve,
)
from .policies._acting import load_policy as load_policy
from .tasks.path_following import PathFollowing as PathFollowing
