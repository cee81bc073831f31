"""Policies by their names: built-in controllers, the paper's at each pace, tuned ones, planners, and trained ones."""

from types import MappingProxyType

from pter_gym.benchmark.pacing import damping_table, paced
from pter_gym.benchmark.runs import PACKAGE
from pter_gym.benchmark.tuned import SUFFIX, find_tuned
from pter_gym.controllers import CONTROLLERS, Controller, Random
from pter_gym.controllers.impedance import Impedance
from pter_gym.controllers.predictive import Honest, Privileged, Settings
from pter_gym.errors import unknown_name
from pter_gym.policies import load_policy, shipped_policies

PLANNERS = MappingProxyType({"predictive": Privileged, "predictive-honest": Honest})
"""Policies that plan, by name."""

GUIDE = "single-dof-tuned"
GUIDE_TABLE = PACKAGE / "presets" / "guide.toml"
"""What guides them, with gains of its own: a plan cannot follow a law that switches within its knots."""


def find_policy(name: str, seed: int = 0, scenario: str = "standard") -> Controller:
    """Return a policy by name: a controller with a damper for each pace, tuned gains, one that plans, or trained.

    Parameters
    ----------
    name
        In ``CONTROLLERS``, one of those with gains and ``-tuned`` after its name, in ``PLANNERS``, or a trained policy.
    seed
        Of the random policy, and of those that plan.
    scenario
        For which dampers were solved and gains tuned; see ``pter_gym.benchmark.tuned.find_tuned``.

    Raises
    ------
    ParameterError
        If there is no policy of that name, or no gains for it.
    """
    if name in PLANNERS:
        return PLANNERS[name](find_tuned(GUIDE, scenario, path=GUIDE_TABLE), Settings(seed=seed))
    if name.endswith(SUFFIX):
        return find_tuned(name, scenario)
    controller = find_controller(name, seed)
    dampers = damping_table().get(scenario, {}).get(name)
    return paced(controller, dampers) if dampers and isinstance(controller, Impedance) else controller


def find_controller(name: str, seed: int = 0) -> Controller:
    """Return a built-in controller with its default gains, or a trained policy that the package ships, by name.

    Parameters
    ----------
    name
        Its name.
    seed
        Of the random policy.

    Raises
    ------
    ParameterError
        If there is neither of that name; it tells the nearest.
    """
    trained = shipped_policies()
    if name in trained:
        return load_policy(name)
    if name not in CONTROLLERS:
        raise unknown_name("policies", name, (*CONTROLLERS, *trained))
    kind = CONTROLLERS[name]
    return Random(seed=seed) if kind is Random else kind()
