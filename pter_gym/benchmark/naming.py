"""Policies as a user writes them: by name, by the path of an exported one, or as ``package.module:attribute``.

Names are those of built-in controllers, the paper's at each pace, tuned ones, planners, and trained ones.
"""

import os
import re
from importlib.metadata import EntryPoint
from types import MappingProxyType
from typing import cast

from pter_gym.benchmark.pacing import damping_table, paced
from pter_gym.benchmark.runs import PACKAGE
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.benchmark.tuned import SUFFIX, TUNED, find_tuned
from pter_gym.controllers import CONTROLLERS, Controller, Random
from pter_gym.controllers.impedance import Impedance
from pter_gym.controllers.predictive import Honest, Privileged, Settings
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.internal.files import FilePath, find_path
from pter_gym.policies import read_policy as read_policy_file
from pter_gym.policies import shipped_policies
from pter_gym.policies.files import is_here, is_path

PLANNERS = MappingProxyType({"predictive": Privileged, "predictive-honest": Honest})
"""Policies that plan, by name."""

GUIDE = "single-dof-tuned"
GUIDE_TABLE = PACKAGE / "presets" / "guide.toml"
"""What guides them, with gains of its own: a plan cannot follow a law that switches within its knots."""

CODE = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")
"""How an attribute of a module is written."""


def read_policy(name: FilePath, seed: int = 0, scenario: str = "standard") -> AnyPolicy:
    """Return a policy as a user writes it: ``package.module:attribute``, or what ``find_policy`` finds.

    Parameters
    ----------
    name
        The attribute is a controller or a callable from observations to volts; a class is called without arguments to
        make one. Its module is imported into this process.
    seed, scenario
        As in ``find_policy``.

    Raises
    ------
    ParameterError
        If there is none.
    """
    name = text_of(name)
    if not is_code(name):
        return find_policy(name, seed, scenario)
    if not CODE.fullmatch(name):
        raise ParameterError(
            f"policies: there is no {name!r}: code must be written as package.module:attribute, in letters, digits, _"
        )
    try:
        found = EntryPoint(name, name, "").load()
    except (ImportError, AttributeError) as error:
        raise ParameterError(f"policies: there is no {name!r}: {error}") from None
    if not isinstance(found, type):
        return found
    try:
        return found()
    except TypeError as error:
        raise ParameterError(f"policies: {name!r} must be made without arguments: {error}") from error


def is_code(name: str) -> bool:
    """Tell whether a user means an attribute of a module, ``package.module:attribute``."""
    return ":" in name and not is_path(name)


def is_built_in(name: str) -> bool:
    """Tell whether this is the name of a built-in or shipped policy."""
    return name.removesuffix(SUFFIX) in (*CONTROLLERS, *PLANNERS, *shipped_policies())


def find_policy(name: FilePath, seed: int = 0, scenario: str = "standard") -> Controller:
    """Return a policy by name: a controller with a damper for each pace, tuned gains, one that plans, or trained.

    Parameters
    ----------
    name
        In ``CONTROLLERS``, one of those with gains and ``-tuned`` after its name, in ``PLANNERS``, a trained policy, or
        the path of an exported one, as in ``pter_gym.policies.read_policy``.
    seed
        Of the random policy, and of those that plan.
    scenario
        For which dampers were solved and gains tuned; see ``pter_gym.benchmark.tuned.find_tuned``.

    Raises
    ------
    ParameterError
        If there is no policy of that name, or no gains for it.
    """
    name = text_of(name)
    known = (*CONTROLLERS, *TUNED, *PLANNERS, *shipped_policies())
    if not is_path(name) and name not in known and not is_here(name):
        raise unknown_name("policies", name, known)
    if name in PLANNERS:
        return PLANNERS[name](find_tuned(GUIDE, scenario, path=GUIDE_TABLE), Settings(seed=seed))
    if name.endswith(SUFFIX) and not is_path(name):
        return find_tuned(name, scenario)
    controller = find_controller(name, seed)
    dampers = damping_table().get(scenario, {}).get(name)
    return paced(controller, dampers) if dampers and isinstance(controller, Impedance) else controller


def find_controller(name: FilePath, seed: int = 0) -> Controller:
    """Return a built-in controller with its default gains, or a trained policy that the package ships, by name.

    Parameters
    ----------
    name
        Its name, or the path of an exported policy, as in ``pter_gym.policies.read_policy``.
    seed
        Of the random policy.

    Raises
    ------
    ParameterError
        If there is neither of that name; it tells the nearest.
    DataError
        If a file of the policy is not what it must be.
    """
    name = text_of(name)
    if name in CONTROLLERS:
        kind = CONTROLLERS[name]
        return Random(seed=seed) if kind is Random else kind()
    if is_path(name) or name in shipped_policies() or is_here(name):
        return read_policy_file(name)
    raise unknown_name("policies", name, (*CONTROLLERS, *shipped_policies()))


def text_of(name: FilePath) -> str:
    """Return a name or path as text that says which of both it is, or raise a ParameterError."""
    given = cast("object", name)
    if isinstance(given, str):
        return given
    if not isinstance(given, os.PathLike):
        raise ParameterError(f"policies must be names or paths, got {given!r:.200}")
    text = str(find_path("policies", name))
    return text if is_path(text) else f"./{text}"
