"""What is trained: hyper-parameters and the arguments of a run."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, cast

from pter_gym import params
from pter_gym._internal.codec import Codec, dataclasses_in, tuple_of
from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.reading import read_toml
from pter_gym.benchmark import PACES
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params import (
    BASELINE,
    Machine,
    MachineSpread,
    middle_of,
    require,
    require_kind,
    require_number,
    require_whole,
)
from pter_gym.policies._trained import MAX_LAYERS, are_hidden
from pter_gym.policies.tuned import TUNED
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import STARTS, RewardWeights

ALGORITHMS = ("ppo", "residual")
"""What ``pter train`` trains: the clutch voltages, or corrections to a controller.

Each has a table NAME.toml here.
"""

ALL = "all"
"""Name for all scenarios of ``draws.MIXED``, and for a pace drawn among those of the scores."""

NO_BASE = "none"
"""Name of the base of a policy that corrects no controller."""

BASES = (NO_BASE, "impedance", "torque-feedback", *TUNED)
"""What a policy may correct: the paper's laws, and those with tuned gains."""

PARTS = 2
"""Parts of the worlds, each on a core; results depend on their number, not on that of cores."""

SMOKE = {"worlds": 64, "steps": 32, "contexts": 16, "minibatch": 512, "epochs": 2}
"""Hyper-parameters of a short run that shows that training works, not that it learns."""

CODEC = Codec(dataclasses_in(params))
"""Stores the machine of a training."""


@dataclass(frozen=True, kw_only=True)
class Settings(RewardWeights):
    """Hyper-parameters, in addition to the reward weights.

    Attributes
    ----------
    base
        Controller that the policy corrects, ``"none"`` for none; its gains are those for the
        scenario.
    reach
        Voltage that an action of 1 adds to the base's [V]; not used without a base.
    history, averages
        Delays, in steps, at which the networks also see their inputs, and time constants, in
        steps, of averages that they also see.
    hidden, value_hidden
        Units of the hidden layers of policy and value. The value network also sees the true state
        of a world and the parameters of its machine and task.
    frame_skip
        Control steps for which an action is held. Steps, discounts and the exploration's
        persistence count the environment's steps, not control steps.
    worlds, steps
        Worlds that are simulated at once, and steps of each between two updates.
    episode
        Steps after which a training episode is truncated.
    starts
        How training episodes begin, one of ``pter_gym.tasks.path_following.STARTS``.
    truncation
        Distance from the path at which a training episode is truncated [m].
    contexts
        Number of drawn machines and tasks to train on.
    minibatch, epochs
        Samples of a gradient step, and gradient steps for each sample.
    learning_rate
        Initial learning rate; it falls linearly to ``learning_rate_end``.
    discount, trace
        γ, and λ of generalised advantage estimation, for one step.
    deviation, deviation_end
        Initial and final σ of the exploration. After ``exploring``, a share of the training, it
        falls exponentially.
    persistence
        ρ of the exploration: the share of its noise that remains one step later.
    reward_scale
        Factor of the rewards for learning at the medium pace; at other commanded paces, in inverse
        proportion to them.
    effort_share
        Share of the training in which voltage costs ``effort``; then it costs nothing.
    clip, value_weight, max_gradient
        Clip range of the likelihood ratio, weight of the value loss, and limit of the gradient
        norm.
    """

    base: str
    reach: float
    history: tuple[int, ...]
    averages: tuple[int, ...]
    hidden: tuple[int, ...]
    value_hidden: tuple[int, ...]
    worlds: int
    steps: int
    episode: int
    starts: str
    truncation: float
    contexts: int
    minibatch: int
    epochs: int
    learning_rate: float
    learning_rate_end: float
    discount: float
    trace: float
    deviation: float
    deviation_end: float
    exploring: float
    persistence: float
    reward_scale: float
    clip: float
    value_weight: float
    max_gradient: float
    frame_skip: int = 1
    effort_share: float = 1.0

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for name, choices in (("base", BASES), ("starts", STARTS)):
            if getattr(self, name) not in choices:
                raise unknown_name(name, getattr(self, name), choices)
        for name in ("worlds", "steps", "episode", "contexts", "frame_skip", "minibatch", "epochs"):
            require_whole(self, name)
        above_zero = (
            "reach",
            "truncation",
            "learning_rate",
            "max_gradient",
            "reward_scale",
            "deviation",
        )
        for name in (*above_zero, "deviation_end"):
            require_number(self, name, above=0.0)
        for name in ("discount", "trace", "exploring", "effort_share"):
            require_number(self, name, at_least=0.0, at_most=1.0)
        for name in ("learning_rate_end", "value_weight"):
            require_number(self, name, at_least=0.0)
        require_number(self, "clip", above=0.0, below=1.0)
        require_number(self, "persistence", at_least=0.0, below=1.0)
        alone = self.base == NO_BASE or self.frame_skip == 1
        require(alone, self, "frame_skip", "1 with a base, which acts at every control step")
        for name in ("history", "averages", "hidden", "value_hidden"):
            sizes = getattr(self, name)
            require(_are_sizes(sizes), self, name, "whole numbers from 1 to 1024", got=sizes)
        require(are_hidden(self.hidden), self, "hidden", f"at most {MAX_LAYERS - 1} layers")
        require(self.worlds % PARTS == 0, self, "worlds", f"a multiple of {PARTS}")
        samples = self.worlds * self.steps
        even = samples % self.minibatch == 0 and self.minibatch % PARTS == 0
        require(even, self, "minibatch", f"an even divisor of worlds × steps = {samples}")
        self.reward()

    def reward(self) -> RewardWeights:
        """Return the weights of the reward."""
        return RewardWeights(
            **{item.name: getattr(self, item.name) for item in fields(RewardWeights)}
        )

    def deviation_at(self, done: float) -> float:
        """Return σ after a share of the training."""
        fallen = (
            max(0.0, done - self.exploring) / (1.0 - self.exploring)
            if self.exploring < 1.0
            else 0.0
        )
        return self.deviation * (self.deviation_end / self.deviation) ** min(fallen, 1.0)

    def learning_rate_at(self, done: float) -> float:
        """Return the learning rate after a share of the training."""
        return self.learning_rate_end + (self.learning_rate - self.learning_rate_end) * max(
            1.0 - done, 0.0
        )


def _are_sizes(value: Any) -> bool:
    return type(value) is tuple and all(
        type(each) is int and 1 <= each <= 1024 for each in cast(Any, value)
    )


def load_settings(algorithm: str, file: FilePath | None = None, **changes: Any) -> Settings:
    """Return the hyper-parameters of an algorithm; those in a TOML file, then ``changes``, replace
    the defaults.

    Raises
    ------
    ParameterError
        If there is no such algorithm or hyper-parameter (the nearest is suggested), or a value is
        out of range.
    DataError
        If the file cannot be read.
    """
    if algorithm not in ALGORITHMS:
        raise unknown_name("algorithm", algorithm, ALGORITHMS)
    values = read_toml(Path(__file__).parent / f"{algorithm}.toml", "config")
    if file is not None:
        values |= read_toml(expand_path("config", file), "config")
    return settings_from(values | changes)


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Return hyper-parameters from plain values; raises as ``load_settings``."""
    known = [item.name for item in fields(Settings)]
    for name in values:
        if name not in known:
            raise unknown_name("config", name, known)
    try:
        return Settings(**{name: tuple_of(value) for name, value in values.items()})
    except TypeError as error:
        raise ParameterError(f"config: {error}") from None


@dataclass(frozen=True, kw_only=True)
class TrainingArguments:
    """The arguments of a training run.

    Attributes
    ----------
    algorithm
        One of ``ALGORITHMS``.
    scenario, pace
        Names; both may be ``"all"``.
    steps
        Total steps in all worlds; rounded up to whole rollouts.
    seed
        Seed ≥ 0 of weights, worlds, training episodes and actions.
    settings
        Hyper-parameters.
    checkpoint_every, validate_every
        Rollouts between two checkpoints, and between two validations.
    validation_episodes
        Episodes of a validation at each pace.
    machine
        A machine, or machines about one, in place of drawn ones; None for those of the scenario.
    """

    algorithm: str
    scenario: str
    pace: str
    steps: int
    seed: int
    settings: Settings
    checkpoint_every: int = 10
    validate_every: int = 40
    validation_episodes: int = 64
    machine: Machine | MachineSpread | None = None

    def __post_init__(self) -> None:
        """Check names and numbers."""
        for name, choices in (
            ("algorithm", ALGORITHMS),
            ("scenario", (ALL, *SCENARIOS)),
            ("pace", (ALL, *PACES)),
        ):
            if getattr(self, name) not in choices:
                raise unknown_name(name, getattr(self, name), choices)
        for name in ("steps", "checkpoint_every", "validate_every", "validation_episodes"):
            require_whole(self, name)
        require_whole(self, "seed", at_least=0, below=2**31)
        require_kind(self, "machine", Machine, MachineSpread, type(None))

    @property
    def nominal(self) -> Machine:
        """The machine that a base law is bound to."""
        return BASELINE if self.machine is None else middle_of(self.machine)

    @property
    def paces(self) -> tuple[str, ...]:
        """Names of the commanded paces in training."""
        return tuple(PACES) if self.pace == ALL else (self.pace,)

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {**asdict(self), "machine": CODEC.to_plain(self.machine)}


def arguments_from(content: Mapping[str, Any]) -> TrainingArguments:
    """Return arguments from plain data, as made by ``Arguments.as_json``."""
    values = dict(content)
    settings = settings_from(values.pop("settings"))
    return TrainingArguments(
        settings=settings, machine=CODEC.from_plain(values.pop("machine", None)), **values
    )
