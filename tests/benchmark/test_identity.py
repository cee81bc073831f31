"""What a policy is: its content, never what it says of itself."""

from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym.benchmark import PerSeed, ResultsFolder, find_policy, fresh_seed, run_scenario
from pter_gym.benchmark.identity import SAID, derived_seed, identity_of
from pter_gym.compiled.layout import Layout
from pter_gym.controllers import Free, Impedance, Locked, PerClutch, Random, bind, device
from pter_gym.controllers.base import Policy
from pter_gym.controllers.predictive import Honest, Privileged, Settings
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine
from pter_gym.policies import Neural, read_policy
from pter_gym.tasks.path_following import observation_layout

TRAINED = "ppo-standard"


def content_of(policy: Any, sensors: Any = "force", *, trusted: bool = False) -> str | None:
    return identity_of(policy, bind(policy, BASELINE, observation_layout(BASELINE, sensors)), trusted=trusted)


def release(obs: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros((len(obs), 4), np.float32)


class Says:
    """A callable that says what it is."""

    def __init__(self, identity: object, volts: float = 0.0) -> None:
        self.identity = identity
        self.volts = volts

    def __call__(self, obs: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.full((len(obs), 4), self.volts, np.float32)


@device
def releasing(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(0.0, 0.0, 0.0, 0.0)


@device
def holding(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(24.0, 24.0, 24.0, 24.0)


def of_tuple(volts: float) -> Any:
    weights = np.zeros(2000)
    weights[1000] = volts
    read = (weights,)

    @device
    def law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
        return PerClutch(read[0][1000], read[0][1000], read[0][1000], read[0][1000])

    return law


def of_submodule(volts: float) -> Any:
    read, inner = ModuleType("outer"), ModuleType("outer.inner")
    vars(read)["inner"], vars(inner)["VOLTS"] = inner, volts

    @device
    def law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
        return PerClutch(read.inner.VOLTS, read.inner.VOLTS, read.inner.VOLTS, read.inner.VOLTS)

    return law


def of_enum(volts: float) -> Any:
    read = Enum("Volts", {"HELD": volts})

    @device
    def law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
        return PerClutch(read.HELD.value, read.HELD.value, read.HELD.value, read.HELD.value)

    return law


def of_object(volts: float) -> Any:
    read = SimpleNamespace(volts=volts)

    @device
    def law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
        return PerClutch(read.volts, read.volts, read.volts, read.volts)

    return law


@dataclass(frozen=True)
class Mine:
    """A controller of somebody's own, with a compiled law."""

    law: Any
    gain: float = 0.0

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        return Policy(np.array([self.gain]), layout, self.law)

    def __repr__(self) -> str:
        return "Mine()"


def changed(policy: Neural, factor: float) -> Neural:
    """The same card with other weights."""
    weights = (policy.network.weights[0] * factor, *policy.network.weights[1:])
    return Neural(policy.card, replace(policy.network, weights=weights))


def test_different_content_is_another_policy() -> None:
    trained = read_policy(TRAINED)
    policies = [
        Free(),
        Locked(),
        Random(seed=1),
        Impedance(),
        Impedance(stiffness=1.0),
        find_policy("impedance"),
        find_policy("impedance", scenario="everything"),
        find_policy("single-dof-tuned"),
        trained,
        changed(trained, 1.0 + 1e-15),
        Mine(releasing),
        Mine(holding),
        Mine(holding, 1.0),
        Privileged(Free()),
        Honest(Free()),
        Honest(Impedance()),
        Honest(Free(), Settings(horizon=10)),
    ]
    found = [content_of(policy) for policy in policies]
    assert len(set(found)) == len(found)
    assert all(each is not None and len(each) == 64 for each in found)
    assert content_of(Impedance(), "torque") != content_of(Impedance()), "it sees other observations"


def test_the_same_content_is_the_same_policy() -> None:
    for make in (Impedance, lambda: read_policy(TRAINED), lambda: Mine(holding), lambda: Honest(Impedance())):
        assert content_of(make()) == content_of(make())
    trained = read_policy(TRAINED)
    card = replace(trained.card, name="another", about={}, weights_sha256="0" * 64)
    assert content_of(Neural(card, trained.network)) == content_of(trained), "a name is no content"


def test_nobody_can_tell_what_a_callable_does() -> None:
    trained = read_policy(TRAINED)

    class Child(Neural):
        pass

    class Rigged(Policy):
        pass

    class Reads:
        def begin(self, worlds: int) -> Any:
            return np.zeros((worlds, 0))

        def __call__(self, inputs: Any, memory: Any) -> Any:
            return inputs[:, :4], memory

    own_method = Neural(trained.card, trained.network)
    object.__setattr__(own_method, "bind", lambda *_: release)
    own_act = bind(Free(), BASELINE, observation_layout(BASELINE, "force"))
    own_act.act = release  # type: ignore[method-assign]
    unknown: list[Any] = [
        release,
        Says("agent 7"),
        Honest(release),  # type: ignore[arg-type]
        Child(trained.card, trained.network),
        Neural(trained.card, Reads()),  # type: ignore[arg-type]
        trained.bind(BASELINE, observation_layout(BASELINE, "torque")),
        Rigged(np.zeros(5), observation_layout(BASELINE, "force")),
        own_method,
        own_act,
        Mine(of_object(0.0)),
    ]
    for policy in unknown:
        assert content_of(policy) is None


def test_what_a_callable_says_is_believed_if_the_caller_says_so() -> None:
    assert content_of(Says("agent 7"), trusted=True) == f"{SAID}agent 7"
    assert content_of(Says(7), trusted=True) is None
    assert content_of(release, trusted=True) is None
    said = content_of(Free())
    assert content_of(Says(said), trusted=True) != said


def test_the_score_of_another_policy_is_not_reused(tmp_path: Path) -> None:
    """Another callable that repeats an identity, and other weights under the same card."""
    folder = ResultsFolder(tmp_path)
    trained = read_policy(TRAINED)
    for one, two in ((Says("agent 7"), Says("agent 7", 24.0)), (trained, changed(trained, 0.5))):
        runs = [
            run_scenario("standard", {"agent": each}, ["brisk"], episodes=1, results=folder)[0] for each in (one, two)
        ]
        assert runs[0].scores["path_error_m"] != runs[1].scores["path_error_m"]


@pytest.mark.parametrize("law", [of_tuple, of_submodule, of_enum])
def test_the_score_of_a_law_that_reads_another_value_is_not_reused(tmp_path: Path, law: Any) -> None:
    folder = ResultsFolder(tmp_path)
    runs = [
        run_scenario("standard", {"mine": Mine(law(volts))}, ["brisk"], episodes=1, results=folder)[0]
        for volts in (0.0, 12.0)
    ]
    assert runs[0].conditions.identity != runs[1].conditions.identity
    assert runs[0].scores["path_error_m"] != runs[1].scores["path_error_m"]
    assert content_of(Mine(law(12.0))) == content_of(Mine(law(12.0)))


def test_what_is_judged_is_what_acts() -> None:
    """A controller that binds to another policy the second time gains nothing: it is bound once."""

    class Twice:
        def __init__(self) -> None:
            self.times = 0

        def bind(self, machine: Machine, layout: Layout) -> Policy:
            self.times += 1
            return (Free() if self.times == 1 else Locked()).bind(machine, layout)

    two = run_scenario("standard", {"twice": Twice(), "free": Free()}, ["brisk"], episodes=66, num_threads=1)
    assert two[0].conditions.identity == two[1].conditions.identity
    assert two[0].scores["path_error_m"].tolist() == two[1].scores["path_error_m"].tolist()


# --- the seed of fresh episodes ---


def test_the_derived_seed_follows_from_all_that_is_judged() -> None:
    seed = fresh_seed("standard", {"a": Free(), "b": Locked()})
    assert 0 <= seed < 2**64
    assert seed == fresh_seed("standard", {"b": Locked(), "c": Free()}), "neither from the order nor from the names"
    others = [
        fresh_seed("everything", {"a": Free(), "b": Locked()}),
        fresh_seed("standard", {"a": Free()}),
        fresh_seed("standard", {"a": Free(), "b": Random(seed=1)}),
        fresh_seed("standard", {"a": Free(), "b": PerSeed((Locked(), Random(seed=1)))}),
        fresh_seed("standard", ["impedance"]),
        derived_seed({"a": [content_of(Free(), "torque")], "b": [content_of(Locked(), "torque")]}, "code", "standard"),
    ]
    assert len({seed, *others}) == 1 + len(others)


@pytest.mark.parametrize("policy", [release, Says("agent 7"), PerSeed((Free(), release)), Mine(of_object(0.0))])
def test_no_seed_follows_from_what_nobody_can_tell(policy: Any) -> None:
    with pytest.raises(ParameterError, match="fresh must be a whole number for 'mine'"):
        fresh_seed("standard", {"free": Free(), "mine": policy})
