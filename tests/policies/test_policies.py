"""Trained policies as files: what they do, and that other files are refused before a number is used."""

import json
import math
import pickle
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save as save_tensors

from pter_gym._engine.batch import Batch
from pter_gym.benchmark import PACES, find_policy
from pter_gym.benchmark._identity import identity_of
from pter_gym.benchmark.simulation import simulate
from pter_gym.benchmark.tuned import find_tuned
from pter_gym.controllers import bind
from pter_gym.errors import DataError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.policies import (
    LSTM,
    SHIPPED,
    Base,
    Card,
    Input,
    Interface,
    Network,
    Neural,
    read_policy,
    shipped_policies,
    write_policy,
)
from pter_gym.policies._cards import fields_of
from pter_gym.policies._files import MOST_CARD, MOST_WEIGHTS, check_name
from pter_gym.policies._interface import LIMIT, available, seen_without
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import observation_layout

LAYOUT = observation_layout(BASELINE, "torque")
INPUTS = (Input("normal_error", 0.0, 0.01), Input("pace_error", 0.0, 0.5), Input("heading_a_cos"))
HIDDEN = (5, 3)
BASE = Base("torque-feedback", (0.1, 0.4), ({"damping_tangential": 400.0}, {"damping_tangential": 100.0}))


def content_of(policy: Any) -> str | None:
    """What the benchmark takes a policy for."""
    return identity_of(policy, bind(policy, BASELINE, LAYOUT))


def make_card(**changes: Any) -> Card:
    known: dict[str, Any] = {
        "name": "tested",
        "observation": fields_of(LAYOUT),
        "voltage_max": 24.0,
        "interface": Interface(inputs=INPUTS, reach=12.0),
        "hidden": HIDDEN,
        "weights_sha256": "",
    }
    return Card(**{**known, **changes})


def make_tensors(card: Card) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in card.shapes.items()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    card = make_card()
    write_policy(card, make_tensors(card), "# tested\n", tmp_path)
    return tmp_path


def observations(count: int = 16) -> np.ndarray:
    """What worlds of everything see after some steps under random voltages."""
    machines, tasks = zip(*find_scenario("everything").randomisation(contexts=count, seed=4).pairs(), strict=True)
    batch = Batch(machines, tasks)
    batch.reset(range(count))
    rng = np.random.default_rng(0)
    for _ in range(9):
        obs = batch.step(rng.uniform(0.0, 24.0, (count, 4))).obs
    return obs


def test_a_policy_is_its_network_between_scaled_inputs_and_volts(folder: Path) -> None:
    policy = read_policy("tested", folder)
    tensors = make_tensors(policy.card)
    obs = observations(24)
    values = obs * LAYOUT.scales
    error = LAYOUT.physical(obs, "normal_error") / 0.01
    pace = (LAYOUT.physical(obs, "speed_along") / LAYOUT.physical(obs, "pace") - 1.0) / 0.5
    theta_a = np.arctan2(values[:, 1], values[:, 0])
    heading = np.arctan2(LAYOUT.physical(obs, "heading_sin"), LAYOUT.physical(obs, "heading_cos"))
    hidden = np.stack([error, pace, np.cos(heading - theta_a)], axis=1).clip(-LIMIT, LIMIT)
    for k in range(3):
        hidden = hidden @ tensors[f"layer_{k}.weight"].T.astype(float) + tensors[f"layer_{k}.bias"]
        hidden = np.tanh(hidden) if k < 2 else hidden
    expected = np.clip(12.0 + 12.0 * np.clip(hidden, -1.0, 1.0), 0.0, 24.0)
    volts = policy.bind(BASELINE, LAYOUT)(obs)
    assert volts.dtype == np.float32
    np.testing.assert_allclose(volts, expected, atol=1e-5)
    assert np.ptp(volts, axis=0).min() > 0.1
    np.testing.assert_allclose(policy.bind(BASELINE, LAYOUT)(obs[3]), expected[3], atol=1e-5)


@pytest.mark.parametrize("name", ["torque-feedback", "single-dof"])
def test_a_residual_of_zero_is_its_base_in_every_bit(name: str, tmp_path: Path) -> None:
    schedule = find_tuned(f"{name}-tuned")
    given = {field.name for field in fields(schedule.knots[0][1])}
    gains = tuple({each: getattr(controller, each) for each in given} for _, controller in schedule.knots)
    assert any(row["pace_integral"] > 0.0 for row in gains), "the law should have to remember"
    base = Base(name, tuple(pace for pace, _ in schedule.knots), gains)
    card = make_card(interface=Interface(inputs=(*INPUTS, Input("base_2")), reach=8.0, base=base))
    zeros = {name: np.zeros(shape, np.float32) for name, shape in card.shapes.items()}
    write_policy(card, zeros, "", tmp_path)
    machines, tasks = zip(*find_scenario("everything").randomisation(contexts=24, seed=8).pairs(), strict=True)
    batch = Batch(machines, tasks)
    ran = [
        simulate(batch, controller.bind(BASELINE, batch.layout), range(24), 150)
        for controller in (read_policy("tested", tmp_path), schedule)
    ]
    assert len({task.pace for task in tasks}) > 10
    np.testing.assert_array_equal(*ran)


def test_a_residual_reaches_so_many_volts_from_its_base(tmp_path: Path) -> None:
    card = make_card(interface=Interface(inputs=INPUTS, reach=2.0, base=BASE), hidden=(4,))
    tensors = {name: np.zeros(shape, np.float32) for name, shape in card.shapes.items()}
    tensors["layer_1.bias"][:] = (0.5, -0.5, 3.0, -3.0)
    write_policy(card, tensors, "", tmp_path)
    policy = read_policy("tested", tmp_path)
    obs = observations()
    bound = policy.card.interface.bind(BASELINE, LAYOUT)
    _, base = bound.see(obs, bound.begin(len(obs)))
    expected = np.clip(base + np.array([1.0, -1.0, 2.0, -2.0]), 0.0, 24.0)
    np.testing.assert_allclose(policy.bind(BASELINE, LAYOUT)(obs), expected, atol=1e-5)


def test_a_history_is_what_was_seen_some_steps_ago_and_the_start_before(tmp_path: Path) -> None:
    interface = Interface(inputs=INPUTS[:2], reach=1.0, history=(1, 3))
    assert interface.size == 6
    bound = interface.bind(BASELINE, LAYOUT)
    alone = replace(interface, history=()).bind(BASELINE, LAYOUT)
    rows = [observations(5) * factor for factor in (1.0, 0.9, 0.8, 0.7, 0.6)]
    plain = [alone.see(row, alone.begin(5))[0] for row in rows]
    past = bound.begin(5)
    for k, row in enumerate(rows):
        seen, _ = bound.see(row, past)
        expected = np.concatenate([plain[max(k - age, 0)] for age in (0, 1, 3)], axis=1)
        assert seen.tobytes() == expected.tobytes()
    past.forget(np.arange(5) == 2)
    seen, _ = bound.see(rows[0], past)
    assert seen[2].tobytes() == np.tile(plain[0][2], 3).tobytes()
    assert seen[1, 2:4].tobytes() == plain[4][1].tobytes()
    with pytest.raises(ParameterError, match="history must be rising"):
        replace(interface, history=(3, 1))
    with pytest.raises(ParameterError, match="history must be rising"):
        replace(interface, history=(65,))


def test_averages_follow_slowly(folder: Path) -> None:
    interface = Interface(inputs=INPUTS[:2], reach=1.0, history=(1,), averages=(4, 50))
    bound = interface.bind(BASELINE, LAYOUT)
    past = bound.begin(3)
    first, second = observations(3), 0.5 * observations(3)
    start = bound.see(first, past)[0]
    assert start.tobytes() == np.tile(start[:, :2], 4).tobytes()
    steps = [bound.see(second, past)[0] for _ in range(60)]
    begin, end = start[:, :2], steps[0][:, :2]
    for k, seen in enumerate(steps):
        for column, constant in ((4, 4), (6, 50)):
            expected = end + (begin - end) * (1.0 - 1.0 / constant) ** (k + 1)
            np.testing.assert_allclose(seen[:, column : column + 2], expected, rtol=1e-9, atol=1e-12)
    with pytest.raises(ParameterError, match="averages must be rising"):
        replace(interface, averages=(50, 4))


def test_inputs_are_limited_and_ended_worlds_give_numbers(folder: Path) -> None:
    bound = read_policy("tested", folder).card.interface.bind(BASELINE, LAYOUT)
    obs = np.full((2, len(LAYOUT)), 25.0, np.float32)
    obs[1] = 0.0
    inputs, _ = bound.see(obs, bound.begin(2))
    assert inputs[0, 0] == LIMIT
    assert np.isfinite(inputs).all()


def test_a_squashed_policy_has_tanh_behind_its_last_layer(folder: Path, tmp_path: Path) -> None:
    card = make_card(squashed=True, name="squashed")
    write_policy(card, make_tensors(card), "", tmp_path)
    plain, squashed = (read_policy(name, tmp_path).network for name in ("tested", "squashed"))
    rows = np.random.default_rng(0).normal(size=(7, 3))
    linear, _ = Network(plain.weights, plain.biases)(rows, np.zeros((7, 0)))
    np.testing.assert_array_equal(plain(rows, np.zeros((7, 0)))[0], linear)
    np.testing.assert_array_equal(squashed(rows, np.zeros((7, 0)))[0], np.tanh(linear))


def remembered(tensors: dict[str, np.ndarray], inputs: np.ndarray) -> list[float]:
    """Outputs of an LSTM after some inputs of one world, one unit after the other."""
    units = len(tensors["lstm.bias"]) // 4
    shown, cells = [0.0] * units, [0.0] * units
    for row in inputs:
        gates = [
            float(bias) + sum(map(float, weight * row)) + sum(map(float, back * np.array(shown)))
            for weight, back, bias in zip(
                *(tensors[f"lstm.{name}"] for name in ("weight_inputs", "weight_hidden", "bias")), strict=True
            )
        ]
        enter, keep, new, show = (gates[units * k : units * (k + 1)] for k in range(4))
        cells = [
            c / (1 + math.exp(-k)) + math.tanh(n) / (1 + math.exp(-e))
            for c, k, n, e in zip(cells, keep, new, enter, strict=True)
        ]
        shown = [math.tanh(c) / (1 + math.exp(-s)) for c, s in zip(cells, show, strict=True)]
    return shown


def test_a_policy_with_memory_remembers_each_world_until_it_is_reset(tmp_path: Path) -> None:
    card = make_card(interface=Interface(inputs=INPUTS, reach=12.0), lstm=6)
    tensors = make_tensors(card)
    write_policy(card, tensors, "", tmp_path)
    policy = read_policy("tested", tmp_path)
    bound = card.interface.bind(BASELINE, LAYOUT)
    rows = [observations(5) * np.float32(factor) for factor in (1.0, 0.9, 0.8, 0.7)]
    seen = np.stack([bound.see(row, bound.begin(5))[0] for row in rows])
    acting = policy.bind(BASELINE, LAYOUT)
    for t, row in enumerate(rows):
        volts = acting(row)
        hidden = np.array([remembered(tensors, seen[: t + 1, world]) for world in range(5)])
        outputs, _ = replace(policy.network, lstm=None)(hidden, np.zeros((5, 0)))
        np.testing.assert_allclose(volts, np.clip(12.0 + 12.0 * outputs.clip(-1.0, 1.0), 0.0, 24.0), atol=1e-4)
    assert np.abs(acting(rows[0]) - policy.bind(BASELINE, LAYOUT)(rows[0])).max() > 0.1
    acting.reset()
    assert acting(rows[0]).tobytes() == policy.bind(BASELINE, LAYOUT)(rows[0]).tobytes()
    assert acting(rows[0][:2]).tobytes() == policy.bind(BASELINE, LAYOUT)(rows[0][:2]).tobytes()


def test_what_was_written_is_read(folder: Path) -> None:
    policy = read_policy("tested", folder)
    assert policy.card == replace(make_card(), weights_sha256=policy.card.weights_sha256)
    assert shipped_policies(folder) == ("tested",)
    for k, weight in enumerate(policy.network.weights):
        assert weight.astype(np.float32).tobytes() == make_tensors(policy.card)[f"layer_{k}.weight"].tobytes()


def test_policies_of_a_folder_come_by_name(tmp_path: Path) -> None:
    for name in "fbhdaceg":
        (tmp_path / f"{name}.json").touch()
    assert shipped_policies(tmp_path) == tuple("abcdefgh")


def test_people_can_read_what_a_card_is_about(tmp_path: Path) -> None:
    card = make_card(about={"by": "Jürgen"})
    path = write_policy(card, make_tensors(card), "", tmp_path)
    assert "Jürgen" in path.read_text(encoding="utf-8")
    assert read_policy("tested", tmp_path).card.about == {"by": "Jürgen"}


def test_the_most_inputs_and_layers_are_accepted(tmp_path: Path) -> None:
    card = make_card(hidden=8 * (1,), interface=Interface(inputs=256 * INPUTS[:1], reach=12.0))
    write_policy(card, make_tensors(card), "", tmp_path)
    found = read_policy("tested", tmp_path).card
    assert (found.hidden, found.interface) == (card.hidden, card.interface)


def test_the_identity_follows_what_acts_and_nothing_else(folder: Path) -> None:
    policy = read_policy("tested", folder)
    told = Neural(replace(policy.card, about={"score": 1.0}), policy.network)
    other = Neural(replace(policy.card, interface=replace(policy.card.interface, reach=11.0)), policy.network)
    assert content_of(told) == content_of(policy)
    assert content_of(other) != content_of(policy)
    weights = (policy.network.weights[0] * 1.001, *policy.network.weights[1:])
    changed = Neural(policy.card, replace(policy.network, weights=weights))
    assert content_of(changed) != content_of(policy)
    memories = [LSTM(np.ones((4, 3)), np.ones((4, 1)), np.full(4, bias)) for bias in (0.0, 0.0, 1.0)]
    known = [content_of(Neural(policy.card, replace(policy.network, lstm=memory))) for memory in memories]
    assert None not in known
    assert (known[0] == known[1], known[0] == known[2]) == (True, False)


def test_a_card_says_how_long_a_decision_is_held_and_an_older_one_does_not(tmp_path: Path) -> None:
    card = make_card(interface=Interface(inputs=INPUTS, reach=12.0, frame_skip=3))
    write_policy(card, make_tensors(card), "# tested\n", tmp_path)
    policy = read_policy("tested", tmp_path)
    assert bind(policy, BASELINE, LAYOUT).frame_skip == 3
    path = tmp_path / "tested.json"
    content = json.loads(path.read_text("utf-8"))
    del content["interface"]["frame_skip"]
    path.write_text(json.dumps(content), "utf-8")
    older = read_policy("tested", tmp_path)
    assert bind(older, BASELINE, LAYOUT).frame_skip == 1
    assert content_of(older) != content_of(policy)
    content["interface"]["frame_skip"] = 0
    path.write_text(json.dumps(content), "utf-8")
    with pytest.raises(DataError, match="frame_skip must be"):
        read_policy("tested", tmp_path)


def test_other_observations_are_refused_with_both_named(folder: Path) -> None:
    policy = read_policy("tested", folder)
    with pytest.raises(ParameterError, match=r"torque_4 \[20 N·m\]; these have cos_a \[1 1\].*\]$"):
        policy.bind(BASELINE, observation_layout(BASELINE, "encoders"))
    weak = replace(BASELINE, clutch=replace(BASELINE.clutch, voltage_max=20.0))
    with pytest.raises(ParameterError, match="voltage_max must be 24 V, got 20"):
        policy.bind(weak, LAYOUT)
    with pytest.raises(ParameterError, match=f"{len(LAYOUT)} entries"):
        policy.bind(BASELINE, LAYOUT)(np.zeros((2, 5), np.float32))


@pytest.mark.parametrize("name", ["../tested", "", "Tested", "tested.json", "/etc/passwd", "a--b", "n" * 181])
def test_a_name_is_never_a_path(name: str, folder: Path) -> None:
    with pytest.raises(ParameterError, match="names of small letters"):
        read_policy(name, folder)
    card = make_card(name=name)
    with pytest.raises(ParameterError, match="names of small letters"):
        write_policy(card, make_tensors(card), "", folder)


Break = Callable[[dict[str, Any]], Any]


def _set(**values: Any) -> Break:
    return lambda card: card.update(values)


def _in_interface(**values: Any) -> Break:
    return lambda card: card["interface"].update(values)


def _base(**values: Any) -> dict[str, Any]:
    return {"controller": "impedance", "paces": [1], "gains": [{}], **values}


BROKEN: dict[str, tuple[Break, str]] = {
    "another format": (_set(format=2), "format must be 1"),
    "another environment": (_set(environment="PTER/PathFollowing-v9"), "PathFollowing-v0.*PathFollowing-v9"),
    "a key too many": (_set(code="import os"), "fields of Card must be among .* got 'code'"),
    "a key too few": (lambda card: card.pop("squashed"), "squashed is missing"),
    "another name": (_set(name="other"), "belongs to 'other'"),
    "a layer of no units": (_set(hidden=[5, 0]), "hidden"),
    "too many layers": (_set(hidden=[1] * 9), "hidden"),
    "an endless voltage": (_set(voltage_max=10**400), "refused"),
    "an input in a text": (_in_interface(inputs=[{"name": "x", "center": "0", "scale": 1}]), "center"),
    "an input of no scale": (_in_interface(inputs=[{"name": "pace", "center": 0, "scale": 0}]), "scale"),
    "no reach": (_in_interface(reach=-1), "reach"),
    "a history of fractions": (_in_interface(history=[1.5]), "history"),
    "an unknown base": (_in_interface(base=_base(controller="os")), "controller"),
    "an unknown gain": (_in_interface(base=_base(gains=[{"stifness": 1}])), "did you mean 'stiffness'"),
    "a gain out of range": (_in_interface(base=_base(gains=[{"stiffness": -1}])), "stiffness"),
    "gains for another number of paces": (_in_interface(base=_base(paces=[1, 2])), "gains"),
    "paces that fall": (_in_interface(base=_base(paces=[2, 1], gains=[{}, {}])), "rising"),
    "a squashing of 1": (_set(squashed=1), "squashed must be True or False, got 1"),
    "an LSTM of too many units": (_set(lstm=513), "lstm must be a whole number from 0 to 512, got 513"),
    "an LSTM without tensors": (_set(lstm=3), "lstm.weight_inputs"),
    "a wrong checksum": (_set(weights_sha256="0" * 64), "SHA-256"),
    "an entry with more": (
        lambda card: card["observation"][1].update(more=1),
        "observation must hold objects with name, unit and scale",
    ),
    "an entry of no scale": (lambda card: card["observation"][0].update(scale=0), "scale > 0, got"),
    "too many entries": (lambda card: card.update(observation=257 * card["observation"][:1]), "at most 256"),
    "too many inputs": (
        lambda card: card["interface"].update(inputs=257 * card["interface"]["inputs"][:1]),
        "at most 256",
    ),
    "layers in a number": (_set(hidden=5), "hidden must be a list of at most 8, got 5"),
    "about in a list": (_set(about=[]), "about"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_wrong_card_is_refused(kind: str, folder: Path) -> None:
    file = folder / "tested.json"
    card = json.loads(file.read_text(encoding="utf-8"))
    change, message = BROKEN[kind]
    change(card)
    file.write_text(json.dumps(card), encoding="utf-8")
    with pytest.raises(DataError, match=message):
        read_policy("tested", folder)


def test_what_is_not_to_be_seen_goes_by_name_or_group() -> None:
    names = available(observation_layout(BASELINE, "force"), residual=True)
    assert seen_without(names, []) == names
    for group, members in {
        "torque": ["torque_1", "torque_2", "torque_3", "torque_4"],
        "force": ["force_along", "force_across"],
        "base": ["base_1", "base_2", "base_3", "base_4"],
        "heading_a": ["heading_a_cos", "heading_a_sin"],
        "pace": ["pace"],
        "pace_error": ["pace_error"],
    }.items():
        assert [name for name in names if name not in seen_without(names, [group])] == members
    assert len(seen_without(names, ["torque", "torque_2", "force"])) == len(names) - 6
    with pytest.raises(ParameterError, match=r"blind.*'torqe'.*did you mean 'torque'"):
        seen_without(names, ["torqe"])
    with pytest.raises(ParameterError, match="blind must leave something"):
        seen_without(["torque_1", "torque_2"], ["torque"])


def test_an_input_that_is_not_observed_is_refused(folder: Path) -> None:
    with pytest.raises(ParameterError, match="did you mean 'normal_error'"):
        Interface(inputs=(Input("normal_eror"),), reach=1.0).bind(BASELINE, LAYOUT)
    with pytest.raises(ParameterError, match="inputs must be among"):
        Interface(inputs=(Input("base_1"),), reach=1.0).bind(BASELINE, LAYOUT)


class Payload:
    """What a pickle would do when it is loaded."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("executed"),)


HOSTILE: dict[str, bytes] = {
    "a pickle": pickle.dumps(Payload()),
    "a list": b"[]",
    "large": b" " * (MOST_CARD + 1),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_cards_are_refused(kind: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "tested.json").write_bytes(HOSTILE[kind])
    with pytest.raises(DataError, match="refused"):
        read_policy("tested", folder)
    assert not (folder / "executed").exists()


def whole(**changes: Any) -> dict[str, np.ndarray]:
    tensors = {**make_tensors(make_card()), **changes}
    return {name: values for name, values in tensors.items() if values is not None}


GOOD = make_tensors(make_card())
NAN = np.where(np.arange(3) == 1, np.nan, 0.0).astype(np.float32)


WEIGHTS: dict[str, bytes] = {
    "a pickle": pickle.dumps(Payload()),
    "truncated": save_tensors(GOOD)[:-4],
    "a header beyond the file": struct.pack("<Q", 2**40) + b"{}",
    "transposed": save_tensors(whole(**{"layer_1.weight": np.ascontiguousarray(GOOD["layer_1.weight"].T)})),
    "another type": save_tensors(whole(**{"layer_0.bias": np.zeros(5)})),
    "a tensor too few": save_tensors(whole(**{"layer_2.bias": None})),
    "a tensor too many": save_tensors(whole(extra=np.zeros(1, np.float32))),
    "NaN": save_tensors(whole(**{"layer_1.bias": NAN})),
    "large": b"\0" * (MOST_WEIGHTS + 1),
}


@pytest.mark.parametrize("kind", WEIGHTS)
def test_hostile_weights_are_refused(kind: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even where the card knows their checksum."""
    import hashlib

    monkeypatch.chdir(folder)
    (folder / "tested.safetensors").write_bytes(WEIGHTS[kind])
    card = json.loads((folder / "tested.json").read_text(encoding="utf-8"))
    card["weights_sha256"] = hashlib.sha256(WEIGHTS[kind]).hexdigest()
    (folder / "tested.json").write_text(json.dumps(card), encoding="utf-8")
    with pytest.raises(DataError, match="refused"):
        read_policy("tested", folder)
    assert not (folder / "executed").exists()


def test_missing_weights_and_weights_that_do_not_fit_are_refused(folder: Path) -> None:
    (folder / "tested.safetensors").unlink()
    with pytest.raises(DataError, match="there is no such file"):
        read_policy("tested", folder)
    card = make_card(name="other")
    with pytest.raises(DataError, match="refused"):
        write_policy(card, whole(**{"layer_0.bias": None}), "", folder)
    assert not (folder / "other.json").exists()


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_acts_and_says_what_it_is(name: str) -> None:
    policy = read_policy(name)
    assert content_of(find_policy(name)) == content_of(policy)
    volts = policy.bind(BASELINE, LAYOUT)(observations())
    assert volts.shape == (16, 4)
    assert ((volts >= 0.0) & (volts <= 24.0)).all()
    assert set(policy.card.about["validation"]) == set(PACES)
    assert policy.card.about["command"] in (SHIPPED / f"{name}.md").read_text(encoding="utf-8")


def test_a_policy_that_sets_the_voltages_needs_numpy_and_safetensors_alone(folder: Path) -> None:
    program = (
        "import sys; from pathlib import Path; import numpy as np\n"
        "from pter_gym.policies import read_policy\n"
        f"policy = read_policy('tested', Path({str(folder)!r}))\n"
        "print(*sorted({name.split('.')[0] for name in sys.modules}))\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not set(result.stdout.split()) & {"torch", "stable_baselines3", "numba", "scipy", "matplotlib", "pickle5"}


def test_layers_have_at_least_one_unit_and_at_most_as_many_as_a_card_allows() -> None:
    assert make_card(hidden=(1, 1024)).hidden == (1, 1024)
    for hidden in ((0,), (1025,)):
        with pytest.raises(ParameterError):
            make_card(hidden=hidden)
    check_name("a" * 180)
    with pytest.raises(ParameterError, match="180"):
        check_name("a" * 181)
