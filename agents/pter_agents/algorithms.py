"""What ``pter train`` can train: a table for each algorithm, and the module that says how it learns.

An algorithm NAME is NAME.toml beside this file: under ``algorithm`` what its policy decides and the module that has its
``LEARNER``, then the usual values of its hyper-parameters. Several algorithms may share a module. Nothing here needs
torch until an algorithm's module is asked for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from numpy.typing import NDArray

from pter_gym.errors import ParameterError, unknown_name
from pter_gym.internal.codec import tuple_of
from pter_gym.internal.files import FilePath, find_path
from pter_gym.internal.reading import MOST_TOML, parse_toml, read_text

if TYPE_CHECKING:
    from pter_agents.networks import Actor
    from pter_agents.settings import Settings
    from pter_agents.worlds import Worlds

State = dict[str, NDArray[Any]]
"""All that a training's future depends on, as arrays by name."""

FOLDER = Path(__file__).parent

ENTRY = "algorithm"
"""Key under which a file says that it is an algorithm's, and not hyper-parameters for one."""

SMOKE = {"worlds": 64, "steps": 32, "contexts": 16}
"""Hyper-parameters of a run that shows that training works, not that it learns."""


class Model(Protocol):
    """What is trained.

    Attributes
    ----------
    steps
        Control steps of all worlds so far.
    rollout
        Control steps that ``advance`` adds.
    """

    steps: int
    rollout: int

    def advance(self) -> Mapping[str, float]:
        """Collect a rollout, learn from it, and return what is worth a log; FloatingPointError if it diverges."""
        ...

    def actor(self) -> "Actor":
        """Return the policy's mean action."""
        ...

    def get_state(self) -> State:
        """Return copies of all that the training's future depends on."""
        ...

    def set_state(self, state: State) -> None:
        """Go on where ``get_state`` was called."""
        ...

    def set_weights(self, state: State) -> None:
        """Take the networks of a state alone."""
        ...

    def close(self) -> None:
        """Stop threads."""
        ...


@dataclass(frozen=True, kw_only=True)
class Learner:
    """How an algorithm learns: ``LEARNER`` in its module.

    Attributes
    ----------
    settings
        Its hyper-parameters.
    smoke
        Those that differ in a smoke run, in addition to ``SMOKE``.
    make_model
        Makes an untrained model from hyper-parameters, worlds in as many parts of the same size as ``parts``, the
        control steps of the whole training, and the seed of all that it draws.
    parts
        Parts of the worlds.
    """

    settings: "type[Settings]"
    smoke: Mapping[str, Any]
    make_model: "Callable[[Any, Sequence[Worlds], int, int], Model]"
    parts: int


class Algorithm(NamedTuple):
    """What an algorithm's policy decides, and the module that has its ``LEARNER``."""

    action: str
    module: str

    @property
    def learner(self) -> Learner:
        """How it learns; needs the agents extra."""
        return import_module(self.module).LEARNER


def read_table(file: FilePath) -> dict[str, Any]:
    """Return the values of a TOML file, or raise a ParameterError."""
    file = find_path("config", file)
    try:
        return parse_toml(read_text(file, MOST_TOML))
    except (OSError, ValueError) as error:
        raise ParameterError(f"config {file} cannot be read: {error}") from None


def listed(folder: Path) -> Mapping[str, Algorithm]:
    """Return the algorithms by name whose tables are in a folder."""
    tables = {path.stem: read_table(path) for path in sorted(folder.glob("*.toml"))}
    return MappingProxyType({name: Algorithm(**table[ENTRY]) for name, table in tables.items() if ENTRY in table})


ALGORITHMS = listed(FOLDER)
"""The algorithms by name."""


def find_algorithm(name: str) -> Algorithm:
    """Return an algorithm.

    Raises
    ------
    ParameterError
        If there is none of that name; it tells the nearest.
    """
    if name not in ALGORITHMS:
        raise unknown_name("algorithm", name, ALGORITHMS)
    return ALGORITHMS[name]


def load_settings(algorithm: str, file: FilePath | None = None) -> "Settings":
    """Return the hyper-parameters of an algorithm, with those in a file in place of the usual ones.

    Raises
    ------
    ParameterError
        If there is no such algorithm or hyper-parameter, which tells the nearest, or a value is out of range, or the
        file cannot be read.
    """
    find_algorithm(algorithm)
    values = read_table(FOLDER / f"{algorithm}.toml")
    del values[ENTRY]
    if file is not None:
        values |= read_table(file)
    return settings_from(algorithm, values)


def smoke_settings(algorithm: str, settings: "Settings", **changes: Any) -> "Settings":
    """Return hyper-parameters of a smoke run with some changes; networks and what they see stay as they are."""
    return settings_from(algorithm, {**asdict(settings), **SMOKE, **find_algorithm(algorithm).learner.smoke, **changes})


def settings_from(algorithm: str, values: Mapping[str, Any]) -> "Settings":
    """Return the hyper-parameters of an algorithm from plain values; see ``load_settings``."""
    kind = find_algorithm(algorithm).learner.settings
    known = {item.name: item.type for item in fields(kind)}
    for name in values:
        if name not in known:
            raise unknown_name("config", name, known)
    values = {**{item.name: item.default for item in fields(kind) if item.default is not MISSING}, **values}
    for name, expected in known.items():
        if name not in values:
            raise ParameterError(f"config must hold {name}")
        if expected is str and not isinstance(values[name], str):
            raise ParameterError(f"Settings.{name} must be a string, got {values[name]!r}")
    return kind(**{name: tuple_of(value) for name, value in values.items()})
