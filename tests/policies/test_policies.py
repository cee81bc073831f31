"""Trained policies: the compiled network against NumPy, and their files."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load, save

from pter_gym._engine.batch import Batch
from pter_gym.controllers._network import tanh
from pter_gym.errors import DataError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.policies import read_policy, shipped_policies, write_policy
from pter_gym.policies._base_law import BaseLaw
from pter_gym.policies._files import SHIPPED, read_header
from pter_gym.policies._interface import input_names, input_values
from pter_gym.tasks.path_following import PathFollowing
from rollouts import Acting, releasing


def test_tanh() -> None:
    for x in np.linspace(-25.0, 25.0, 2001):
        assert tanh(x) == pytest.approx(math.tanh(x), abs=1e-12)


@pytest.mark.smoke
@pytest.mark.parametrize("name", shipped_policies())
def test_a_compiled_network_is_that_of_numpy(name: str) -> None:
    trained, batch = releasing(name, 0.0), Batch(BASELINE, PathFollowing(), 3)
    interface, layout = trained.interface, batch.layout
    policy = Acting(trained.bind(BASELINE, layout))
    base = interface.base and Acting(interface.base.bind(BASELINE, layout))
    names = input_names(layout, residual=base is not None)
    columns = [names.index(each.name) for each in interface.inputs]
    center, scale = (
        np.array([getattr(each, k) for each in interface.inputs]) for k in ("center", "scale")
    )
    obs, _ = batch.reset([1, 2, 3])
    past: list[np.ndarray] = []
    means = None
    for _ in range(30):
        volts = np.full((3, 4), 12.0) if base is None else base(obs)
        values = input_values(obs * layout.scales, layout, None if base is None else volts)
        seen = values[:, columns]
        present = np.clip((seen - center) / scale, -10.0, 10.0)
        past = [present, *(past or [present] * 64)]
        shares = 1.0 / np.array(interface.averages)[:, None, None]
        means = np.repeat(present[None], len(shares), axis=0) if means is None else means
        means = means + shares.reshape(-1, 1, 1) * (present - means)
        values = np.hstack([present, *(past[age] for age in interface.history), *means])
        for k, (weight, bias) in enumerate(trained.layers):
            values = values @ weight.T.astype(float) + bias
            values = np.tanh(values) if k < len(trained.layers) - 1 else np.clip(values, -1.0, 1.0)
        expected = (
            24.0 * ((values + 1) / 2) ** 2
            if interface.normalised
            else volts + interface.reach * values
        )
        found = policy(obs)
        np.testing.assert_allclose(found, np.clip(expected, 0.0, 24.0), atol=2e-5)
        obs = batch.step(found).obs


def test_no_correction_engages_a_clutch_that_the_base_releases() -> None:
    policy, batch = releasing("residual", 1e-6), Batch(BASELINE, PathFollowing(pace=0.5), 3)
    acting = Acting(policy.bind(BASELINE, batch.layout))
    plain = Acting(releasing("residual", 0.0).bind(BASELINE, batch.layout))
    base = BaseLaw(policy.interface.base, BASELINE, batch.layout, 32.0)
    memory, most = base.start(3), np.ones((3, 4), np.float32)
    obs, _ = batch.reset([1, 2, 3])
    released = 0
    for _ in range(60):
        volts, memory = base.act(obs, memory)
        off = volts < 0.0
        assert (base.seen(obs, volts)[:, -4:] >= 0.0).all()
        assert (base.corrected(most, volts)[off] == 0.0).all()
        assert (base.corrected(most, volts)[~off] == 24.0).all()
        found, engaged = acting(obs), plain(obs)
        assert (found[off] == 0.0).all()
        released += (engaged[off] > 0.0).sum()
        obs = batch.step(found).obs
    assert released > 0


def test_a_file_round_trips(tmp_path: Path) -> None:
    policy = read_policy("residual")
    again = read_policy(write_policy(policy, tmp_path / "mine"))
    assert (again.interface, again.about, again.name) == (policy.interface, policy.about, "mine")
    assert all(
        a.tobytes() == b.tobytes()
        for one, two in zip(again.layers, policy.layers, strict=True)
        for a, b in zip(one, two, strict=True)
    )


def damaged(name: str, change: Callable[[np.ndarray], np.ndarray]) -> bytes:
    """Return a shipped policy's file with one tensor changed."""
    data = (SHIPPED / "ppo-standard.safetensors").read_bytes()
    tensors = load(data)
    return save({**tensors, name: np.ascontiguousarray(change(tensors[name]))}, read_header(data))


CHANGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "nan": lambda array: np.full_like(array, np.nan),
    "short": lambda array: array[:-1],
    "float64": lambda array: array.astype(np.float64),
}


@pytest.mark.parametrize(
    "name", ["layer_0.weight", "layer_1.weight", "layer_1.bias", "layer_2.bias"]
)
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_wrong_tensors_are_refused_by_name(
    name: str, change: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    (tmp_path / "bad.safetensors").write_bytes(damaged(name, change))
    with pytest.raises(DataError, match="layer"):
        read_policy(tmp_path / "bad")


def test_bad_files_are_refused(tmp_path: Path) -> None:
    data = (SHIPPED / "ppo-standard.safetensors").read_bytes()
    for k, bad in enumerate(
        (b"", data[:100], data[:-4], data.replace(b"pter-gym policy 1", b"pter-gym policy 9"))
    ):
        (tmp_path / f"bad-{k}.safetensors").write_bytes(bad)
        with pytest.raises(DataError, match="policy"):
            read_policy(tmp_path / f"bad-{k}")
    with pytest.raises(ParameterError, match="residual"):
        read_policy("residul")
