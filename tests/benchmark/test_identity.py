"""What a policy is: its content, never what it says of itself."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._compiled import digests
from pter_gym._compiled.layout import Layout
from pter_gym.benchmark import PerSeed, find_policy, run_scenario
from pter_gym.benchmark import _runs as runs_module
from pter_gym.benchmark._identity import identity_of
from pter_gym.controllers import Free, Impedance, Locked, PerClutch, Random, bind, device
from pter_gym.controllers._base import Policy
from pter_gym.controllers._predictive import Honest, Privileged, Settings
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine
from pter_gym.policies import Neural, read_policy
from pter_gym.tasks.path_following import observation_layout

TRAINED = "ppo-standard"


def content_of(policy: Any, sensors: Any = "force") -> str | None:
    return identity_of(policy, bind(policy, BASELINE, observation_layout(BASELINE, sensors)))


def release(obs: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.zeros((len(obs), 4), np.float32)


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

    unknown: list[Any] = [
        release,
        Honest(release),  # type: ignore[arg-type]
        Child(trained.card, trained.network),
        Neural(trained.card, Reads()),  # type: ignore[arg-type]
        trained.bind(BASELINE, observation_layout(BASELINE, "torque")),
        Rigged(np.zeros(5), observation_layout(BASELINE, "force")),
        Mine(of_object(0.0)),
    ]
    for policy in unknown:
        assert content_of(policy) is None


def test_a_law_that_reads_another_value_is_another_policy() -> None:
    assert content_of(Mine(of_tuple(0.0))) != content_of(Mine(of_tuple(12.0))) == content_of(Mine(of_tuple(12.0)))


def test_prose_in_the_sources_of_a_law_does_not_make_it_another_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the sources do counts for all policies alike, in the digest of the code."""
    policies = (Impedance(), Mine(holding))
    before = [content_of(policy) for policy in policies]
    monkeypatch.setattr(digests, "_SOURCES_DIGEST", "of sources with another comment")
    assert [content_of(policy) for policy in policies] == before


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


def ridden(policies: Any, scenario: str = "standard") -> dict[tuple[str, int], tuple[str, int | None]]:
    """Ride derived episodes; return which ones each policy and training seed had, and from which seed."""
    runs = run_scenario(scenario, policies, ["brisk"], episodes=1, fresh="derived")
    return {(at.policy, at.seed): (at.data, at.fresh_seed) for at in (run.conditions for run in runs)}


def test_the_episodes_of_a_policy_follow_from_it_alone() -> None:
    """Neither what is judged beside it, nor the order, nor its name or training seed gives it others."""
    alone = ridden({"a": Free()})["a", 0]
    beside = ridden({"b": PerSeed((Locked(), Free())), "a": Free(), "c": Random(seed=1), "free": Free()})
    assert beside["a", 0] == beside["b", 1] == beside["free", 0] == alone
    assert len({*beside.values(), *ridden({"a": Free()}, "hands").values()}) == 4


@pytest.mark.parametrize("policy", [release, PerSeed((Free(), release)), Mine(of_object(0.0))])
def test_no_seed_follows_from_what_nobody_can_tell(policy: Any, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="fresh must be a whole number for 'mine'"):
        run_scenario("standard", {"free": Free(), "mine": policy}, fresh="derived", results=tmp_path / "none")
    assert not (tmp_path / "none").exists()


# --- the code that decides a score


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package's sources, of which the digest is taken."""
    folder = tmp_path / "pter_gym"
    for path in (path for ending in ("py", "toml") for path in runs_module.PACKAGE.rglob(f"*.{ending}")):
        copy = folder / path.relative_to(runs_module.PACKAGE)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)
    monkeypatch.setattr(runs_module, "PACKAGE", folder)
    return folder


def digest() -> str:
    return runs_module.code_digest.__wrapped__()


def test_prose_and_pictures_do_not_change_the_digest_of_the_code(package: Path) -> None:
    before = digest()
    for path in package.rglob("*.py"):
        path.write_text(
            "# a comment\n" + path.read_text("utf-8").replace('"""\n', '  Or so."""  # a comment\n\n', 1), "utf-8"
        )
    with (package / "presets" / "pter.toml").open("a", encoding="utf-8") as file:
        file.write("# a comment\n")
    assert digest() == before == runs_module.code_digest()
    for room in ("tools", "_commands"):
        for path in (package / room).rglob("*.py"):
            path.write_text("DRAWN = 1\n", "utf-8")
    assert digest() == before


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("_physics/friction.py", "2.0 * c.x4", "2.5 * c.x4"),
        ("benchmark/_recorded.py", "PRICE = 2.0", "PRICE = 3.0"),
        ("presets/pter.toml", "value = 0.5645", "value = 0.5646"),
    ],
)
def test_another_number_is_other_code(package: Path, file: str, old: str, new: str) -> None:
    before, path = digest(), package / file
    path.write_text(path.read_text("utf-8").replace(old, new), "utf-8")
    assert digest() != before


def test_a_room_that_does_not_exist_is_told(package: Path) -> None:
    (package / "_physics").rename(package / "mechanics")
    with pytest.raises(
        FileNotFoundError, match=r"_physics decides scores and does not exist: correct DECIDING in .*runs\.py"
    ):
        digest()
