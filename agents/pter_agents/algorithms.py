"""The algorithms of ``pter train``: a table for each, and the module that implements its learning.

An algorithm NAME is defined by NAME.toml beside this file: ``algorithm`` says what its policy decides and which module
has its ``LEARNER``; the default hyper-parameters follow. Several algorithms may share a module. Nothing here needs
torch until an algorithm's module is loaded.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from pter_gym._internal.codec import tuple_of
from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.reading import MOST_TOML, parse_toml, read_text
from pter_gym.errors import ParameterError, unknown_name

if TYPE_CHECKING:
    from pter_agents.networks import Actor
    from pter_agents.settings import TrainingSettings
    from pter_agents.worlds import TrainingWorlds

State = dict[str, Any]
"""All that a training's future depends on: arrays, tensors and numbers, nested by name."""

FOLDER = Path(__file__).parent

ALL = "all"
"""Name for all scenarios of ``worlds.MIXED``, and for a commanded pace that is drawn among those of the scores."""

ENTRY = "algorithm"
"""Key that only the file of an algorithm has."""

SMOKE = {"worlds": 64, "steps": 32, "contexts": 16}
"""Hyper-parameters of a short run that shows that training works, not that it learns."""


class Model(Protocol):
    """A model in training.

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
        """Collect a rollout, learn from it, and return values for the logs; FloatingPointError if it diverges."""
        ...

    def actor(self) -> "Actor":
        """Return the policy's mean action."""
        ...

    def get_state(self) -> State:
        """Return the complete training state, including ``steps``; not copied."""
        ...

    def set_state(self, state: State) -> None:
        """Restore the state from ``get_state``; arrays may have become tensors."""
        ...

    def set_weights(self, state: State) -> None:
        """Restore only the networks of a state."""
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
        Values of a smoke run, in addition to ``SMOKE``.
    make_model
        Makes an untrained model from hyper-parameters, worlds, the total control steps of training, and a seed.
    """

    settings: "type[TrainingSettings]"
    smoke: Mapping[str, Any]
    make_model: "Callable[[Any, TrainingWorlds, int, int], Model]"


class Algorithm(NamedTuple):
    """What an algorithm's policy decides, and the module with its ``LEARNER``."""

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
    """Return, by name, the algorithms whose tables are in a folder."""
    tables = {path.stem: read_table(path) for path in sorted(folder.glob("*.toml"))}
    return MappingProxyType({name: Algorithm(**table[ENTRY]) for name, table in tables.items() if ENTRY in table})


ALGORITHMS = listed(FOLDER)
"""The algorithms by name."""


def find_algorithm(name: str) -> Algorithm:
    """Return an algorithm.

    Raises
    ------
    ParameterError
        If there is none by that name; the message suggests the nearest.
    """
    if name not in ALGORITHMS:
        raise unknown_name("algorithm", name, ALGORITHMS)
    return ALGORITHMS[name]


def load_settings(algorithm: str, file: FilePath | None = None) -> "TrainingSettings":
    """Return the hyper-parameters of an algorithm; those in a file replace the defaults.

    Raises
    ------
    ParameterError
        If there is no such algorithm or hyper-parameter (the nearest is suggested), a value is out of range, or the
        file cannot be read.
    """
    find_algorithm(algorithm)
    values = read_table(FOLDER / f"{algorithm}.toml")
    del values[ENTRY]
    if file is not None:
        values |= read_table(file)
    return settings_from(algorithm, values)


def smoke_settings(algorithm: str, settings: "TrainingSettings", **changes: Any) -> "TrainingSettings":
    """Return hyper-parameters of a smoke run with some changes; networks and their inputs stay the same."""
    return settings_from(algorithm, {**asdict(settings), **SMOKE, **find_algorithm(algorithm).learner.smoke, **changes})


def settings_from(algorithm: str, values: Mapping[str, Any]) -> "TrainingSettings":
    """Return the hyper-parameters of an algorithm from plain values; see ``load_settings``."""
    kind = find_algorithm(algorithm).learner.settings
    known = {item.name: item for item in fields(kind)}
    for name in values:
        if name not in known:
            raise unknown_name("config", name, known)
    for name, item in known.items():
        if name not in values and item.default is MISSING:
            raise ParameterError(f"config must hold {name}")
        if item.type is str and not isinstance(values.get(name), str):
            raise ParameterError(f"{kind.__name__}.{name} must be a string, got {values[name]!r}")
    return kind(**{name: tuple_of(value) for name, value in values.items()})
