"""Data of an earlier version under a newer package: fields that came, defaults that changed, fields that went."""

import gzip
import hashlib
import json
from collections.abc import Callable
from dataclasses import MISSING, field, fields, make_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pter_gym
from pter_gym.benchmark import episodes
from pter_gym.benchmark.naming import GUIDE_TABLE
from pter_gym.benchmark.tuned import TABLE, controller_of, find_tuned, read_table
from pter_gym.compiled.layout import Field, Layout
from pter_gym.controllers import CONTROLLERS, Impedance, SingleDof, TorqueFeedback
from pter_gym.errors import DataError
from pter_gym.internal.codec import Codec
from pter_gym.params import BASELINE, quantity
from pter_gym.params.preset import PRESET, SECTIONS, HandValues, Preset, load_preset, number
from pter_gym.policies import Base, Card, Input, Interface, cards, load_policy, write_policy
from pter_gym.policies.cards import fields_of
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import RewardWeights, observation_layout
from pter_gym.tuning import shipping
from pter_gym.tuning.examination import Assessment
from pter_gym.tuning.search import TunedGains

PRESET_FILE = Path(pter_gym.__file__).parent / "presets" / "pter.toml"
LAYOUT: Layout = observation_layout(BASELINE, "torque")
ADDED = 0.5
NEUTRAL = 0.0


def with_field(kind: type[Any], name: str, declaration: Any) -> type[Any]:
    """A dataclass as a newer package has it: with one more field, or another declaration of one."""
    return make_dataclass(kind.__name__, [(name, float, declaration)], bases=(kind,), frozen=True, kw_only=True)


def added(absent: Any = NEUTRAL) -> Any:
    return quantity("1", "chosen: new", default=ADDED, absent=absent)


def without_field(kind: type[Any], name: str) -> type[Any]:
    kept = [(item.name, item.type, field(metadata=item.metadata)) for item in fields(kind) if item.name != name]
    return make_dataclass(kind.__name__, kept, frozen=True, kw_only=True)


# episodes


@pytest.fixture
def newer_task(monkeypatch: pytest.MonkeyPatch) -> Callable[[type[Any]], None]:
    def install(kind: type[Any]) -> None:
        kinds = {**episodes.CODEC.kinds, kind.__name__: kind}
        monkeypatch.setattr(episodes, "CODEC", Codec(kinds.values()))
        monkeypatch.setattr(episodes, "_decode", episodes._decode.__wrapped__)

    return install


def test_episodes_from_before_a_reward_weight_do_not_weigh_it(newer_task: Any) -> None:
    before = episodes.load_episodes("standard", "slow")
    newer_task(with_field(RewardWeights, "jerk", added()))
    after = episodes.load_episodes("standard", "slow")
    assert after.machines == before.machines
    for new, old in zip(after.tasks, before.tasks, strict=True):
        assert new.reward.jerk == NEUTRAL  # type: ignore[attr-defined]
        assert {**vars(new.reward), "jerk": None} == {**vars(old.reward), "jerk": None}
        assert replace(new, reward=old.reward) == old


def test_episodes_keep_their_values_when_a_default_changes(newer_task: Any) -> None:
    before = episodes.load_episodes("standard", "slow").tasks
    newer_task(with_field(RewardWeights, "failure", quantity("1", "chosen: another", default=7.0)))
    after = episodes.load_episodes("standard", "slow").tasks
    assert [vars(task.reward) for task in after] == [vars(task.reward) for task in before]


def test_episodes_say_which_field_has_no_meaning_for_them(newer_task: Any) -> None:
    newer_task(with_field(RewardWeights, "jerk", added(MISSING)))
    with pytest.raises(DataError, match=r"standard\.json\.gz: stored RewardWeights has no field 'jerk'"):
        episodes.load_episodes("standard", "slow")


def test_episodes_say_which_field_nobody_knows(newer_task: Any) -> None:
    newer_task(without_field(with_field(RewardWeights, "efforts", added()), "effort"))
    with pytest.raises(
        DataError, match=r"standard\.json\.gz: stored fields of RewardWeights .* got 'effort'; did you mean 'efforts'"
    ):
        episodes.load_episodes("standard", "slow")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda content: content.pop("episodes"), "'episodes' is missing"),
        (lambda content: content["episodes"][0].update(machine=10**6), "out of range"),
        (lambda content: content["episodes"][0].update(machine=content["episodes"][0]["task"]), "must be a Machine"),
        (lambda content: content["parts"][0].update(substep=-1.0), "substep must be"),
        (lambda content: content["parts"][0].update(arm=1.0), "arm"),
        (lambda content: content.update(parts=3), "not iterable"),
        (lambda content: content["episodes"][0].update(machine=-1), "out of range"),
        (lambda content: content["episodes"][0].update(task=True), "out of range"),
        (lambda content: content["episodes"][0].update(seed=-1), "out of range"),
        (lambda content: content["episodes"][0].update(seed=1.5), "out of range"),
        (lambda content: content["episodes"][0].update(stratum=3), "must be a str"),
        (lambda content: content.update(scenario=None), "must be a str"),
    ],
)
def test_episodes_that_make_no_sense_are_refused(damage: Any, message: str, tmp_path: Path) -> None:
    path = tmp_path / "standard.json.gz"
    content = json.loads(gzip.decompress((episodes.FOLDER / path.name).read_bytes()))
    damage(content)
    refuse_episodes(gzip.compress(json.dumps(content).encode()), message, path)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x00",
        b"\x1f\x8b\x08\x00",
        gzip.compress(b"[[[", mtime=0),
        gzip.compress(b"\xff", mtime=0),
        gzip.compress(bytes(2**26)),
    ],
)
def test_episodes_that_are_no_packed_json_are_refused(data: bytes, tmp_path: Path) -> None:
    refuse_episodes(data, "", tmp_path / "standard.json.gz")


def refuse_episodes(data: bytes, message: str, path: Path) -> None:
    path.write_bytes(data)
    (path.parent / episodes.CHECKSUMS).write_text(json.dumps({"standard": hashlib.sha256(data).hexdigest()}))
    with pytest.raises(DataError, match=rf"standard\.json\.gz: .*{message}"):
        episodes.load_episodes("standard", "slow", folder=path.parent)


# presets


def install_section(monkeypatch: pytest.MonkeyPatch, kind: type[Any]) -> None:
    monkeypatch.setattr(import_module("pter_gym.params.preset"), "SECTIONS", {**SECTIONS, "hand": kind})


def test_a_preset_from_before_a_number_has_its_meaning_then(monkeypatch: pytest.MonkeyPatch) -> None:
    before = load_preset(PRESET_FILE)
    install_section(monkeypatch, with_field(HandValues, "mass", number("kg", at_least=0.0, absent=NEUTRAL)))
    after = load_preset(PRESET_FILE)
    assert after.hand.mass == NEUTRAL  # type: ignore[attr-defined]
    assert after.provenance["hand.mass"].startswith("chosen")
    assert (after.hand.push, after.hand.force_max) == (before.hand.push, before.hand.force_max)
    assert after.controller == before.controller


def test_a_preset_from_before_a_section_has_its_meaning_then(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = make_dataclass("Motor", [("torque", float, number("N·m", absent=NEUTRAL))], frozen=True, kw_only=True)
    module = import_module("pter_gym.params.preset")
    monkeypatch.setattr(module, "SECTIONS", {**SECTIONS, "motor": kind})
    newer = make_dataclass("Preset", [("motor", kind)], bases=(Preset,), frozen=True, kw_only=True)
    monkeypatch.setattr(module, "Preset", newer)
    found: Any = load_preset(PRESET_FILE)
    assert found.motor == kind(torque=NEUTRAL)
    assert found.arm == PRESET.arm


def test_a_preset_keeps_its_values_when_a_default_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    before = load_preset(PRESET_FILE)
    declaration = number("N")
    declaration.default = 7.0
    install_section(monkeypatch, with_field(HandValues, "push", declaration))
    assert vars(load_preset(PRESET_FILE).hand) == vars(before.hand)


def test_a_preset_says_which_number_is_missing_or_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    install_section(monkeypatch, with_field(HandValues, "mass", number("kg")))
    with pytest.raises(DataError, match=r"pter\.toml: field of hand 'mass' is missing"):
        load_preset(PRESET_FILE)
    install_section(monkeypatch, without_field(with_field(HandValues, "pushing", number("N")), "push"))
    with pytest.raises(DataError, match=r"pter\.toml: unknown field of hand 'push'.*did you mean 'pushing'"):
        load_preset(PRESET_FILE)


# gains


def all_gains() -> dict[str, Any]:
    return {
        f"{path.stem} {scenario} {name} {pace}": vars(controller_of(name, entry, path))
        for path in (TABLE, GUIDE_TABLE)
        for scenario, controllers in read_table(path).items()
        for name, paces in controllers.items()
        for pace, entry in paces.items()
    }


def install_controller(monkeypatch: pytest.MonkeyPatch, name: str, kind: type[Any]) -> None:
    monkeypatch.setitem(CONTROLLERS, name, kind)


def test_shipped_gains_keep_their_values_when_defaults_change(monkeypatch: pytest.MonkeyPatch) -> None:
    before = all_gains()
    for name, kind in (("impedance", Impedance), ("torque-feedback", TorqueFeedback), ("single-dof", SingleDof)):
        changed = with_field(kind, "grip", quantity("1", "chosen: another", default=7.0))
        install_controller(
            monkeypatch, name, with_field(changed, "slip_threshold", quantity("1", "chosen", default=7.0))
        )
    after = all_gains()
    for where, gains in before.items():
        assert {name: after[where][name] for name in gains} == gains, where


def test_shipped_gains_from_before_a_gain_have_its_meaning_then(monkeypatch: pytest.MonkeyPatch) -> None:
    before = find_tuned("single-dof-tuned", "standard")
    install_controller(monkeypatch, "single-dof", with_field(SingleDof, "softness", added()))
    after = find_tuned("single-dof-tuned", "standard")
    for (_, new), (_, old) in zip(after.knots, before.knots, strict=True):
        assert vars(new) == {**vars(old), "softness": NEUTRAL}


def test_gains_say_which_one_is_missing_or_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    install_controller(monkeypatch, "single-dof", with_field(SingleDof, "softness", added(MISSING)))
    with pytest.raises(DataError, match=r"tuned\.toml: stored SingleDof has no field 'softness'"):
        find_tuned("single-dof-tuned", "standard")
    install_controller(monkeypatch, "single-dof", with_field(Impedance, "feedbacks", added()))
    with pytest.raises(DataError, match=r"tuned\.toml: single-dof has no gain 'feedback'.*did you mean 'feedbacks'"):
        find_tuned("single-dof-tuned", "standard")


def test_new_gains_carry_the_defaults_that_they_rely_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_controller(monkeypatch, "impedance", with_field(Impedance, "grip", quantity("1", "chosen", default=3.0)))
    scores = Assessment(0.0, 1.0, 0.0, 0.0)
    study = TunedGains("impedance", "standard", "slow", {"stiffness": 123.0}, scores, 1, 1, 1, 0)
    path = tmp_path / "tuned.toml"
    shipping.add_gains(study, path)
    install_controller(monkeypatch, "impedance", with_field(Impedance, "grip", quantity("1", "chosen", default=7.0)))
    (_, found), *_ = find_tuned("impedance-tuned", "standard", path=path).knots
    assert vars(found) == {**vars(Impedance(stiffness=123.0)), "grip": 3.0}
    text = path.read_text().replace("grip =", "gripp =")
    path.write_text(text)
    with pytest.raises(DataError, match=r"impedance has no gain 'gripp'.*did you mean 'grip'"):
        find_tuned("impedance-tuned", "standard", path=path)
    path.write_text(text.replace("defaults =", "defaults = 1 #"))
    with pytest.raises(DataError, match=r"standard\.impedance\.slow\.defaults must be a table"):
        find_tuned("impedance-tuned", "standard", path=path)


# cards


def written(folder: Path, base: Base | None = None) -> Path:
    """A card and its weights in a folder."""
    card = Card("tested", fields_of(LAYOUT), 24.0, Interface((Input("pace"),), 12.0, base), (2,), "")
    return write_policy(card, {name: np.ones(shape, np.float32) for name, shape in card.shapes.items()}, "", folder)


def base_of(folder: Path) -> Any:
    base = load_policy("tested", folder).card.interface.base
    assert base is not None
    return base.schedule().knots[0][1]


def test_a_new_card_carries_the_gains_that_it_relies_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_controller(monkeypatch, "impedance", with_field(Impedance, "grip", quantity("1", "chosen", default=3.0)))
    path = written(tmp_path, Base("impedance", (PACES["slow"],), ({"stiffness": 123.0},)))
    install_controller(monkeypatch, "impedance", with_field(Impedance, "grip", quantity("1", "chosen", default=7.0)))
    assert vars(base_of(tmp_path)) == {**vars(Impedance(stiffness=123.0)), "grip": 3.0}
    card = json.loads(path.read_text())
    card["interface"]["base"]["gains"] = [{"stiffness": 123.0}]  # as cards were written before
    path.write_text(json.dumps(card))
    assert vars(base_of(tmp_path)) == vars(Impedance(stiffness=123.0))


def test_shipped_cards_from_before_a_gain_have_its_meaning_then(monkeypatch: pytest.MonkeyPatch) -> None:
    before = load_policy("residual").card.interface.base
    assert before is not None
    install_controller(monkeypatch, "single-dof", with_field(SingleDof, "softness", added()))
    after = load_policy("residual").card.interface.base
    assert after is not None
    assert after.gains == tuple({**gains, "softness": NEUTRAL} for gains in before.gains)
    install_controller(monkeypatch, "single-dof", with_field(SingleDof, "softness", added(MISSING)))
    with pytest.raises(DataError, match=r"residual\.json is refused: .*SingleDof has no field 'softness'"):
        load_policy("residual")
    install_controller(monkeypatch, "single-dof", with_field(Impedance, "approaches", added()))
    with pytest.raises(DataError, match=r"residual\.json is refused: .*no gain 'approach'.*did you mean 'approaches'"):
        load_policy("residual")


def test_a_card_from_before_a_field_of_the_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    before = load_policy("ppo-standard").card
    monkeypatch.setattr(cards, "Interface", with_field(Interface, "leak", added()))
    after = load_policy("ppo-standard").card
    assert vars(after.interface) == {**vars(before.interface), "leak": NEUTRAL}
    monkeypatch.setattr(cards, "Interface", with_field(Interface, "leak", added(MISSING)))
    with pytest.raises(DataError, match=r"ppo-standard\.json is refused: .*Interface has no field 'leak'"):
        load_policy("ppo-standard")
    monkeypatch.setattr(cards, "Interface", without_field(with_field(Interface, "reaches", added()), "reach"))
    with pytest.raises(DataError, match=r"fields of Interface .* got 'reach'; did you mean 'reaches'"):
        load_policy("ppo-standard")


# observations


@pytest.mark.parametrize("name", ["residual", "ppo-standard"])
def test_shipped_policies_do_not_look_at_entries_that_came_later(name: str) -> None:
    newer = Layout((*LAYOUT.fields, Field("new", "m", "came later")))
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (5, len(LAYOUT))).astype(np.float32)
    more = np.hstack([observations, np.full((5, 1), 0.5, np.float32)])
    policy = load_policy(name)
    assert np.array_equal(policy.bind(BASELINE, newer)(more), policy.bind(BASELINE, LAYOUT)(observations))
