"""What is trained: hyper-parameters and the arguments of a run."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from pter_gym import hands, params
from pter_gym._internal.codec import Codec, dataclasses_in, tuple_of
from pter_gym._internal.fields import Checked, parameter, require, require_flag, require_kind
from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.reading import read_toml
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.hands import HandSpread, Operator
from pter_gym.params import Machine, MachineSpread
from pter_gym.policies._trained import MAX_LAYERS, MAX_UNITS, are_hidden
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tasks.path_following import STARTS, RewardWeights

ALGORITHMS = ("ppo", "residual", "universal")
"""What ``pter train`` trains: the clutch voltages, or corrections to a controller.

Each has a table NAME.toml here.
"""

MIXED_NAME = "all"
"""Name for all scenarios of ``draws.MIXED``, and for a pace drawn among those of the scores."""

NO_BASE = "none"
"""Name of the base of a policy that corrects no controller."""

NO_TEACHER = ""
"""Name of the teacher of a policy that learns by itself."""

BASES = (NO_BASE, "impedance", "torque-feedback", *tuned_policies())
"""What a policy may correct: the paper's laws, and those with tuned or scaled gains."""

PARTS = 2
"""Parts of the worlds, each on a core; results depend on their number, not on that of cores."""

SMOKE = {"worlds": 64, "steps": 32, "contexts": 16, "minibatch": 512, "epochs": 2}
"""Hyper-parameters of a short run that shows that training works, not that it learns."""

CODEC = Codec(dataclasses_in(params, hands))
"""Stores the machine and the hand of a training."""

OWN = ("machine", "hand")
"""Arguments of a training in place of what its scenario draws."""

ADVERSARY = 0.4
"""``Settings.adversary`` of ``pter train --adversary``."""

SHARE: Any = {"at_least": 0.0, "at_most": 1.0}


@dataclass(frozen=True, kw_only=True)
class Settings(RewardWeights):
    """Hyper-parameters, in addition to the reward weights.

    Steps, discounts and the exploration's persistence count the environment's steps, each of
    ``frame_skip`` control steps. The value network also sees the true state of a world and the
    parameters of its machine and task.
    """

    base: str = parameter("name", "law that the policy corrects, with its gains for the scenario")
    reach: float = parameter("V", "what an action of 1 adds to the base's voltage", above=0.0)
    history: tuple[int, ...] = parameter("steps", "delays at which inputs are seen again")
    averages: tuple[int, ...] = parameter("steps", "time constants of averages that are seen")
    hidden: tuple[int, ...] = parameter("units", "hidden layers of the policy")
    value_hidden: tuple[int, ...] = parameter("units", "hidden layers of the value network")
    worlds: int = parameter("1", "worlds that are simulated at once")
    steps: int = parameter("1", "steps of each world between two updates")
    episode: int = parameter("steps", "length at which a training episode is truncated")
    starts: str = parameter("name", "how episodes begin, one of tasks.path_following.STARTS")
    truncation: float = parameter("m", "distance from the path that truncates", above=0.0)
    contexts: int = parameter("1", "drawn machines and tasks to train on")
    adversary: float = parameter(
        "1", "share of these with hands that push the policy furthest", default=0.0, **SHARE
    )
    teacher: str = parameter(
        "name",
        "policy that is imitated at first, with the same inputs and outputs",
        default=NO_TEACHER,
    )
    imitation: float = parameter(
        "1",
        "share of the training in which this falls from all of the loss to nothing",
        default=0.0,
        **SHARE,
    )
    devices: bool = parameter(
        "1", "whether every pair has another device, of draws.DEVICES", default=False
    )
    minibatch: int = parameter("1", "samples of a gradient step")
    epochs: int = parameter("1", "gradient steps for each sample")
    learning_rate: float = parameter("1", "at the beginning; it falls linearly", above=0.0)
    learning_rate_end: float = parameter("1", "at the end", at_least=0.0)
    discount: float = parameter("1", "γ", **SHARE)
    trace: float = parameter("1", "λ of generalised advantage estimation", **SHARE)
    deviation: float = parameter("1", "σ of the exploration at the beginning", above=0.0)
    deviation_end: float = parameter("1", "σ at the end; it falls exponentially", above=0.0)
    exploring: float = parameter("1", "share of the training after which σ falls", **SHARE)
    persistence: float = parameter(
        "1", "ρ: share of the noise that remains one step later", at_least=0.0, below=1.0
    )
    reward_scale: float = parameter("1", "factor of rewards at the medium pace", above=0.0)
    clip: float = parameter("1", "range of the likelihood ratio about 1", above=0.0, below=1.0)
    value_weight: float = parameter("1", "weight of the value loss", at_least=0.0)
    max_gradient: float = parameter("1", "largest norm of the gradient", above=0.0)
    frame_skip: int = parameter("1", "control steps for which an action is held", default=1)
    effort_share: float = parameter(
        "1", "share of the training in which voltage costs ``effort``", default=1.0, **SHARE
    )

    def __post_init__(self) -> None:
        """Check each field by itself, and what must fit together."""
        super().__post_init__()
        _check_names(self, {"base": BASES, "starts": tuple(STARTS)})
        alone = self.base == NO_BASE or self.frame_skip == 1
        require(alone, self, "frame_skip", "1 with a base, which acts at every control step")
        for name in ("hidden", "value_hidden"):
            accepted = f"at most {MAX_LAYERS - 1} whole numbers from 1 to {MAX_UNITS}"
            require(are_hidden(getattr(self, name)), self, name, accepted)
        require(self.worlds % PARTS == 0, self, "worlds", f"a multiple of {PARTS}")
        require_flag(self, "devices")
        alone = not (self.devices and self.adversary)
        require(alone, self, "adversary", "0 with drawn devices")
        taught = bool(self.teacher) == (self.imitation > 0.0)
        require(taught, self, "imitation", "above 0 with a teacher, and 0 without")
        samples = self.worlds * self.steps
        even = samples % self.minibatch == 0 and self.minibatch % PARTS == 0
        require(even, self, "minibatch", f"an even divisor of worlds × steps = {samples}")

    def reward(self) -> RewardWeights:
        """Return the weights of the reward."""
        return RewardWeights(
            **{item.name: getattr(self, item.name) for item in fields(RewardWeights)}
        )

    def deviation_at(self, done: float) -> float:
        """Return σ after a share of the training."""
        fallen = max(0.0, done - self.exploring) / ((1.0 - self.exploring) or 1.0)
        return self.deviation * (self.deviation_end / self.deviation) ** min(fallen, 1.0)

    def imitation_at(self, done: float) -> float:
        """Return the weight of imitation after a share of the training."""
        return max(0.0, 1.0 - done / self.imitation) if self.teacher else 0.0

    def learning_rate_at(self, done: float) -> float:
        """Return the learning rate after a share of the training."""
        fall = self.learning_rate - self.learning_rate_end
        return self.learning_rate_end + fall * max(1.0 - done, 0.0)


def _check_names(owner: object, choices: Mapping[str, tuple[str, ...]]) -> None:
    for name, known in choices.items():
        if getattr(owner, name) not in known:
            raise unknown_name(name, getattr(owner, name), known)


def load_settings(
    algorithm: str, file: FilePath | None = None, teacher: str = NO_TEACHER, **changes: object
) -> Settings:
    """Return the hyper-parameters of an algorithm, or with a teacher those of a small network that
    imitates it; those in a TOML file, then ``changes``, replace them.

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
    if teacher:
        values |= read_toml(Path(__file__).parent / "student.toml", "config") | {"teacher": teacher}
    if file is not None:
        values |= read_toml(expand_path("config", file), "config")
    return settings_from(values | changes)


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Return hyper-parameters from plain values; raises as ``load_settings``."""
    known = [item.name for item in fields(Settings)]
    for name in values:
        if name not in known:
            raise unknown_name("config", name, known)
    return Settings(**{name: tuple_of(value) for name, value in values.items()})


@dataclass(frozen=True, kw_only=True)
class TrainingArguments(Checked):
    """The arguments of a training run."""

    algorithm: str = parameter("name", "one of ALGORITHMS")
    scenario: str = parameter("name", "of a scenario, or all")
    pace: str = parameter("name", "of a commanded pace, or all")
    steps: int = parameter("1", "in all worlds together; rounded up to whole rollouts")
    seed: int = parameter("1", "of weights, worlds and actions", at_least=0, below=2**31)
    settings: Settings
    checkpoint_every: int = parameter("rollouts", "between two checkpoints", default=10)
    validate_every: int = parameter("rollouts", "between two validations", default=40)
    validation_episodes: int = parameter("1", "of a validation at each pace", default=64)
    machine: Machine | MachineSpread | None = parameter("", "in place of drawn ones", default=None)
    hand: Operator | HandSpread | None = parameter("", "in place of drawn ones", default=None)

    def __post_init__(self) -> None:
        """Check names and numbers."""
        super().__post_init__()
        names = {
            "algorithm": ALGORITHMS,
            "scenario": (MIXED_NAME, *SCENARIOS),
            "pace": (MIXED_NAME, *PACES),
        }
        _check_names(self, names)
        require_kind(self, "machine", Machine, MachineSpread, type(None))
        require_kind(self, "hand", Operator, HandSpread, type(None))
        free = self.machine is None or not self.settings.devices
        accepted = "left out where every pair has a device of its own"
        require(free, self, "machine", accepted, got="a machine")

    @property
    def gains(self) -> str:
        """The scenario whose gains laws have; those of ``everything`` are poor elsewhere."""
        return "standard" if self.scenario == MIXED_NAME else self.scenario

    @property
    def paces(self) -> tuple[str, ...]:
        """Names of the commanded paces in training."""
        return tuple(PACES) if self.pace == MIXED_NAME else (self.pace,)

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        own = {name: CODEC.to_plain(getattr(self, name)) for name in OWN}
        return {**asdict(self), **own}

    def check_same(self, others: "TrainingArguments") -> None:
        """Raise a ParameterError if those of a run to resume differ in more than the steps."""
        known = replace(others, steps=self.steps)
        for ours, theirs in ((self.settings, known.settings), (self, known)):
            for name, mine in vars(ours).items():
                if mine != (other := getattr(theirs, name)):
                    raise ParameterError(
                        f"{name} is {other!r:.200} in the run that is in the folder, "
                        f"got {mine!r:.200}"
                    )


def arguments_from(content: dict[str, Any]) -> TrainingArguments:
    """Return arguments from plain data, as made by ``TrainingArguments.as_json``."""
    content["settings"] = settings_from(content["settings"])
    content |= {name: CODEC.from_plain(content.get(name)) for name in OWN}
    return TrainingArguments(**content)
