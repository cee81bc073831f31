"""Hyper-parameters common to all algorithms: a frozen dataclass that each algorithm extends."""

from dataclasses import dataclass, fields
from typing import Any, get_args

from pter_gym.benchmark.tuned import TUNED
from pter_gym.errors import unknown_name
from pter_gym.params import require, require_flag, require_number, require_whole
from pter_gym.tasks.path_following import MAX_DELAY, STARTS, RewardWeights, Sensing, Sensors

PLAIN = "none"
"""Name of the base of a policy that corrects no controller."""

BASES = (PLAIN, "impedance", "torque-feedback", *TUNED)
"""What a policy may correct: the paper's controllers with a damper for each pace, and those with tuned gains."""


@dataclass(frozen=True, kw_only=True)
class TrainingSettings(RewardWeights):
    """Hyper-parameters of the worlds and of the networks' inputs and outputs, in addition to the reward weights.

    Attributes
    ----------
    base
        Controller that the policy corrects, ``"none"`` for none; its gains are those for the scenario.
    reach
        Voltage of an action of 1, relative to the base or to the middle of the range [V].
    start
        Mean action of the untrained policy.
    normalised
        Whether its actions are the environments' normalised actions, mapped quadratically to the voltage range;
        ``reach`` is then not used.
    sensors
        What the worlds measure: ``"encoders"``, ``"torque"`` or ``"force"``. The benchmark has torque sensors and
        accepts no policy that was trained with others.
    delay
        Sensor delay in control steps, in training and validation; 0 leaves the scenario's sensors unchanged.
    blind
        Observations that the networks do not see, by name or by group: ``"torque"`` is ``torque_1`` to ``torque_4``.
        The base controller of a residual policy and a privileged value network still see them.
    history, averages
        Delays, in control steps, at which the networks also see their inputs, and time constants, in control steps, of
        averages that they also see.
    hidden, value_hidden
        Units of the hidden layers of policy and value.
    privileged
        Whether the value network also sees the true state of a world and the parameters of its machine and task.
    frame_skip
        Control steps for which a decision is held, in training and by the policy. Steps below, histories, averages,
        discounts and the exploration's persistence count decisions.
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
    """

    base: str
    reach: float
    start: float
    normalised: bool
    sensors: Sensors
    delay: int
    blind: tuple[str, ...]
    history: tuple[int, ...]
    averages: tuple[int, ...]
    hidden: tuple[int, ...]
    value_hidden: tuple[int, ...]
    privileged: bool
    worlds: int
    steps: int
    episode: int
    starts: str
    truncation: float
    contexts: int
    frame_skip: int = 1

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for name, known in (("base", BASES), ("sensors", get_args(Sensors)), ("starts", STARTS)):
            if getattr(self, name) not in known:
                raise unknown_name(name, getattr(self, name), known)
        for name in ("reach", "truncation"):
            require_number(self, name, above=0.0)
        require_number(self, "start", at_least=-1.0, at_most=1.0)
        require_whole(self, "delay", at_least=0, below=MAX_DELAY + 1)
        for name in ("worlds", "steps", "episode", "contexts", "frame_skip"):
            require_whole(self, name)
        for name in ("privileged", "normalised"):
            require_flag(self, name)
        for name in ("hidden", "value_hidden"):
            sizes = _tuple_of(self, name, int, "whole numbers from 1 to 1024")
            fits = len(sizes) > 0 and all(1 <= size <= 1024 for size in sizes)
            require(fits, self, name, sizes, "whole numbers from 1 to 1024")
        _tuple_of(self, "blind", str, "a list of names")
        for name in ("history", "averages"):
            _tuple_of(self, name, int, "whole numbers")
        self.reward()

    @property
    def seen(self) -> dict[str, Any]:
        """Fields of the task that all episodes of training and validation share."""
        return {"sensing": Sensing(delay=self.delay)} if self.delay else {}

    @property
    def stated(self) -> dict[str, Any]:
        """Fields of the task that all training episodes share."""
        own = {"reward": self.reward(), "starts": STARTS[self.starts], "truncation_error": self.truncation}
        return {**own, **self.seen}

    def reward(self) -> RewardWeights:
        """Return the weights of the reward."""
        return RewardWeights(**{item.name: getattr(self, item.name) for item in fields(RewardWeights)})


def _tuple_of(settings: TrainingSettings, name: str, kind: type, accepted: str) -> tuple[Any, ...]:
    """Return a field, or raise a ParameterError unless it is a tuple of values of one type."""
    value: Any = getattr(settings, name)
    require(type(value) is tuple and all(type(each) is kind for each in value), settings, name, value, accepted)
    return value
