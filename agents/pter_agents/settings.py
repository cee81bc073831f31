"""Hyper-parameters of training: one frozen dataclass, read from one TOML file for each algorithm."""

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast, get_args

from pter_gym.benchmark.tuned import TUNED
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import require, require_number
from pter_gym.tasks.path_following import RewardWeights, Sensors

FOLDER = Path(__file__).parent

ALGORITHMS = ("ppo", "residual")
"""What ``pter train`` can train: PPO on the voltages, and PPO on corrections to a controller."""

PLAIN = "none"
"""Name of the base of a policy that corrects no controller."""

BASES = (PLAIN, "impedance", "torque-feedback", *TUNED)
"""What a policy may correct: the paper's controllers with a damper for each pace, and those with tuned gains."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Hyper-parameters of proximal policy optimisation; a file with its values stands beside this one.

    Attributes
    ----------
    base
        Controller that the policy corrects, ``"none"`` for none; its gains are those for the scenario.
    reach
        Voltage of an action of 1, relative to the base or to the middle of the range [V].
    start
        Action that the untrained policy takes on average.
    deviation
        Standard deviation of its actions at the beginning.
    sensors
        What the worlds measure: ``"encoders"``, ``"torque"`` or ``"force"``. The benchmark has torque sensors and takes
        no policy that was trained with others.
    blind
        What the networks do not see of it, by name or by group: ``"torque"`` is ``torque_1`` to ``torque_4``. The base
        controller of a residual policy and a privileged value network see it all the same.
    history, averages
        How many control steps ago the networks see their inputs besides those of now, and over about how many they
        see them averaged.
    hidden, value_hidden
        Units of the hidden layers of policy and value.
    privileged
        Whether the value network sees, besides what the policy sees, all that is true of a world: its state, and the
        numbers of its machine and task.
    worlds, steps
        Worlds that are simulated at once, and control steps of each between two updates.
    minibatch, epochs
        Samples of a gradient step, and how often each sample is used.
    learning_rate
        At the beginning; it falls linearly to ``learning_rate_end``.
    discount, trace
        γ and the λ of generalised advantage estimation, for one control step.
    clip, entropy, value_weight, max_gradient, target_kl
        Of PPO, as in Stable-Baselines3; a ``target_kl`` of 0 is none.
    error, pace, acceleration, effort, failure
        Weights of the reward, see ``RewardWeights``.
    drift, window
        Weight [1/s] of a further term of the reward: the relative pace error behind a low-pass of so many control
        steps. Stick-slip hides a mean that is off the pace from the term of the momentary speed.
    episode
        Control steps after which a training episode is truncated.
    contexts
        Number of drawn machines and tasks to train on.
    """

    base: str
    reach: float
    start: float
    deviation: float
    sensors: Sensors
    blind: tuple[str, ...]
    history: tuple[int, ...]
    averages: tuple[int, ...]
    hidden: tuple[int, ...]
    value_hidden: tuple[int, ...]
    privileged: bool
    worlds: int
    steps: int
    minibatch: int
    epochs: int
    learning_rate: float
    learning_rate_end: float
    discount: float
    trace: float
    clip: float
    entropy: float
    value_weight: float
    max_gradient: float
    target_kl: float
    error: float
    pace: float
    acceleration: float
    effort: float
    failure: float
    drift: float
    window: int
    episode: int
    contexts: int

    def __post_init__(self) -> None:
        """Check each number by itself."""
        if self.base not in BASES:
            raise unknown_name("base", self.base, BASES)
        if self.sensors not in get_args(Sensors):
            raise unknown_name("sensors", self.sensors, get_args(Sensors))
        names: tuple[Any, ...] = self.blind
        require(
            type(names) is tuple and all(type(name) is str for name in names), self, "blind", names, "a list of names"
        )
        require_number(self, "reach", above=0.0)
        require_number(self, "start", at_least=-1.0, at_most=1.0)
        for name in ("deviation", "learning_rate", "max_gradient"):
            require_number(self, name, above=0.0)
        for name in ("discount", "trace"):
            require_number(self, name, at_least=0.0, at_most=1.0)
        for name in ("learning_rate_end", "entropy", "value_weight", "target_kl", "drift"):
            require_number(self, name, at_least=0.0)
        require_number(self, "clip", above=0.0, below=1.0)
        for name in ("worlds", "steps", "minibatch", "epochs", "window", "episode", "contexts"):
            require_whole(self, name)
        require(type(self.privileged) is bool, self, "privileged", self.privileged, "true or false")
        for name in ("hidden", "value_hidden"):
            sizes: tuple[Any, ...] = getattr(self, name)
            whole = type(sizes) is tuple and all(type(size) is int and 1 <= size <= 1024 for size in sizes)
            require(whole and len(sizes) > 0, self, name, sizes, "whole numbers from 1 to 1024")
        for name in ("history", "averages"):
            ages: tuple[Any, ...] = getattr(self, name)
            require(type(ages) is tuple and all(type(age) is int for age in ages), self, name, ages, "whole numbers")
        require(
            self.worlds * self.steps % self.minibatch == 0,
            self,
            "minibatch",
            self.minibatch,
            f"a divisor of worlds × steps = {self.worlds * self.steps}",
        )
        self.reward()

    def reward(self) -> RewardWeights:
        """Return the weights of the reward."""
        return RewardWeights(
            error=self.error,
            pace=self.pace,
            acceleration=self.acceleration,
            effort=self.effort,
            failure=self.failure,
        )


def require_whole(owner: object, name: str) -> None:
    """Raise a ParameterError unless a field is a whole number from 1 on."""
    value = getattr(owner, name)
    require(type(value) is int and value >= 1, owner, name, value, "a whole number ≥ 1")


def load_settings(algorithm: str, file: Path | None = None) -> Settings:
    """Return the hyper-parameters of an algorithm, with those in a file in place of the usual ones.

    Raises
    ------
    ParameterError
        If there is no such algorithm or hyper-parameter, which tells the nearest, or a value is out of range, or the
        file cannot be read.
    """
    if algorithm not in ALGORITHMS:
        raise unknown_name("algo", algorithm, ALGORITHMS)
    values = read_table(FOLDER / f"{algorithm}.toml")
    if file is not None:
        values |= read_table(file)
    return settings_from(values)


def settings_from(values: dict[str, Any]) -> Settings:
    """Return hyper-parameters from plain values; see ``load_settings``."""
    known = {item.name: item.type for item in fields(Settings)}
    for name in values:
        if name not in known:
            raise unknown_name("config", name, known)
    for name, kind in known.items():
        if name not in values:
            raise ParameterError(f"config must hold {name}")
        if kind is str and not isinstance(values[name], str):
            raise ParameterError(f"Settings.{name} must be a string, got {values[name]!r}")
    plain: dict[str, Any] = {name: _plain(value) for name, value in values.items()}
    return Settings(**plain)


def _plain(value: Any) -> Any:
    """Return a value as the dataclass has it: files know no tuples."""
    return tuple(cast(list[Any], value)) if isinstance(value, list) else value


def read_table(file: Path) -> dict[str, Any]:
    """Return the values of a TOML file, or raise a ParameterError."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"config {file} cannot be read: {error}") from None
