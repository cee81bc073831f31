"""List the public interface: `python docs/make/interface.py` writes tests/meta/interface.txt.

It has a line for each name of the modules in docs/api.md, up to those behind the commands, with
parameters, defaults and fields, and for what users write or read elsewhere: ids, commands, columns,
entries and keys of files.
"""

import dataclasses
import enum
import inspect
import pkgutil
import re
from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

import gymnasium
import numpy as np
from markup import DOCS, ROOT

from pter_gym import __version__
from pter_gym._commands.main import commands, load_command
from pter_gym.benchmark import ScenarioRun, WorstHand, leaderboards
from pter_gym.benchmark.results import ORIGIN, RUN_ENTRIES, WORST
from pter_gym.benchmark.scores import SCORES
from pter_gym.benchmark.tables import TABLE_ENTRIES
from pter_gym.envs import PathFollowingEnv
from pter_gym.params import BASELINE
from pter_gym.policies import Interface
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, observation_layout

LISTING = ROOT / "tests" / "meta" / "interface.txt"

PLAIN = (bool, int, float, str, type(None))


def modules(*, behind: bool) -> list[str]:
    """Return the names of the modules in docs/api.md, with or without those behind the commands."""
    page, mark, rest = (DOCS / "api.md").read_text("utf-8").partition("## Behind the commands")
    assert mark
    text = page + rest if behind else page
    return re.findall(r"^   (pter_gym[\w.]*)$", text, re.MULTILINE)


def lines() -> Iterator[str]:
    """Yield the lines of the listing."""
    for name in modules(behind=False):
        yield from lines_of_module(pkgutil.resolve_name(name))
    yield from (f"id {each}" for each in sorted(gymnasium.registry) if each.startswith("PTER/"))
    for name in commands():
        yield f"command {name} {signature(load_command(name))}"
    env = PathFollowingEnv(privileged=True)
    board = leaderboards([some_run()])[0].as_json()
    named: dict[str, Iterable[str]] = {
        "scenarios": list(SCENARIOS),
        "paces": list(PACES),
        "observation": observation_layout(BASELINE, "force").names,
        "privileged": env.privileged_layout.names,
        "telemetry": TELEMETRY.names,
        "scores": list(SCORES),
        "run": [*RUN_ENTRIES, "episodes", "strata", WORST, ORIGIN],
        "benchmark.json": board,
        "benchmark.json, policies": board["policies"]["mine"],
        "table": TABLE_ENTRIES,
        "policy": [item.name for item in dataclasses.fields(Interface)],
    }
    for kind, names in named.items():
        yield f"{kind}: {' '.join(names)}"


def some_run() -> ScenarioRun:
    """Return a run that has everything that a run may have."""
    worst = WorstHand(0.1, 0.1, 8192, 12288, BASELINE, PathFollowing())
    values = {name: np.zeros(2) for name in SCORES}
    return ScenarioRun("standard", "medium", "mine", 0, None, ("", ""), values, worst=worst)


def lines_of_module(module: ModuleType) -> Iterator[str]:
    """Yield a line for each public name of a module and each member of its classes."""
    names = getattr(module, "__all__", None) or [
        name
        for name, value in vars(module).items()
        if getattr(value, "__module__", "") == module.__name__
    ]
    for name in sorted(names):
        value = getattr(module, name)
        if name.startswith("_") or inspect.ismodule(value):
            continue
        place = f"{module.__name__}.{name}"
        if get_origin(value) is Literal:
            yield f"{place} = {' | '.join(get_args(value))}"
        elif inspect.isclass(value):
            yield from lines_of_class(place, value)
        elif callable(value):
            yield f"{place}{signature(value)}"
        else:
            yield f"{place}: {type(value).__name__}"


def lines_of_class(place: str, kind: type) -> Iterator[str]:
    """Yield what makes an instance of a class, and its public members."""
    bases = [base for base in kind.__mro__[1:] if not base.__module__.startswith("pter_gym")]
    inherited = {name for base in bases for name in vars(base)}
    is_made = not (issubclass(kind, enum.Enum | BaseException) or vars(kind).get("_is_protocol"))
    yield f"{place}{signature(kind)}" if is_made else place
    for name in sorted(dir(kind)):
        if name.startswith("_") or name in inherited:
            continue
        member = inspect.getattr_static(kind, name)
        if isinstance(member, staticmethod | classmethod):
            member = member.__func__
        if inspect.isfunction(member):
            yield f"{place}.{name}{signature(member)}"
        elif issubclass(kind, enum.Enum):
            yield f"{place}.{name} = {default(getattr(kind, name).value)}"
        else:
            yield f"{place}.{name}"


def signature(function: Any) -> str:
    """Return names, kinds and defaults of parameters."""
    plain = [
        each.replace(
            annotation=each.empty,
            default=each.default if each.default is each.empty else Text(default(each.default)),
        )
        for each in inspect.signature(function).parameters.values()
    ]
    return str(inspect.Signature(plain))


class Text(str):
    """A default that is shown as it is."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the text."""
        return str(self)


def default(value: object) -> str:
    """Return a default that is plain data as code, and of others what kind of thing it is."""
    if value == __version__:
        return "<version>"
    if isinstance(value, tuple) and all(isinstance(each, PLAIN) for each in value):
        return repr(tuple(value))
    return repr(value) if isinstance(value, PLAIN) else f"<{type(value).__name__.strip('_')}>"


def listing() -> str:
    """Return the listing."""
    return "".join(f"{line}\n" for line in lines())


if __name__ == "__main__":
    LISTING.write_text(listing(), "utf-8")
