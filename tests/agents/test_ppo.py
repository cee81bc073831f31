"""The loop of our own: its gradients are Stable-Baselines3's, its likelihood is exact, its noise lasts."""

import os
import subprocess
import sys
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.agents

torch = pytest.importorskip("torch")
algorithms = pytest.importorskip("stable_baselines3")
jax = pytest.importorskip("jax")

from gymnasium import spaces  # noqa: E402
from jax import numpy as jnp  # noqa: E402
from stable_baselines3.common.buffers import RolloutBuffer  # noqa: E402
from stable_baselines3.common.logger import Logger  # noqa: E402

from pter_agents import prepare, training  # noqa: E402
from pter_agents.algorithms import load_settings, settings_from  # noqa: E402
from pter_agents.jax_worlds import JaxWorlds  # noqa: E402
from pter_agents.ppo import PART, PPO, Samples, collect, descend, estimate, loss_of, samples_of  # noqa: E402

LARGEST = 100.0
"""Above all numbers that are seen, in their units: torques in N·m."""

SMALL = {"worlds": 16, "steps": 32, "minibatch": 512, "epochs": 1, "contexts": 4, "episode": 25}


def make(**changes: Any) -> PPO:
    settings = settings_from("ppo", {**asdict(load_settings("ppo")), **SMALL, **changes})
    given = training.Arguments(
        algorithm="ppo", scenario="standard", pace="all", steps=1_000_000, seed=2, settings=settings
    )
    draws = training.make_draws(given)
    interface = prepare.make_interface(settings, "standard", draws, 2)
    model: Any = training.make_model(given, training.make_training_worlds(given, draws, interface))
    return model


def theirs(model: PPO, settings: Any) -> Any:
    """Stable-Baselines3's algorithm with the same networks, whose deviation stays."""
    size = model.networks.value[0].in_features

    class Worlds(__import__("gymnasium").Env):  # never stepped
        observation_space = spaces.Box(-10.0, 10.0, (size,), np.float32)
        action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)

    found = algorithms.PPO(
        "MlpPolicy",
        Worlds(),
        learning_rate=settings.learning_rate,
        n_steps=settings.worlds * settings.steps,
        batch_size=settings.minibatch,
        n_epochs=1,
        clip_range=settings.clip,
        vf_coef=settings.value_weight,
        max_grad_norm=settings.max_gradient,
        normalize_advantage=False,
        policy_kwargs={"net_arch": {"pi": list(settings.hidden), "vf": list(settings.value_hidden)}},
        device="cpu",
    )
    policy = found.policy
    with torch.no_grad():
        policy.log_std.fill_(float(np.log(settings.deviation)))
        for target, source in zip(layers_of(policy), model.networks.parameters(), strict=True):
            target.copy_(source)
    policy.log_std.requires_grad_(False)
    found.set_logger(Logger(None, []))
    return found


def layers_of(policy: Any) -> list[Any]:
    """Weights of the other's networks in the order of ours."""
    both = (policy.mlp_extractor.policy_net, policy.action_net), (policy.mlp_extractor.value_net, policy.value_net)
    return [weight for body, head in both for part in (body, head) for weight in part.parameters()]


def collected(model: PPO, deviation: float) -> Samples:
    """Samples of a rollout of all worlds as one part."""
    settings: Any = model._settings
    shared = model._worlds.shared

    def rollout(going: Any, drawn: Any) -> Samples:
        going, rows = collect(settings, model._worlds, shared, model._weights, going, drawn, deviation)
        return samples_of(settings, model._worlds, model._weights, going, rows)

    drawn, _ = model._draw()
    each = jnp.concatenate([*np.asarray(drawn)], axis=1)[None]
    going = model._reset(shared, jnp.asarray(model._seeds()))
    found = jax.jit(jax.vmap(rollout, axis_name=PART))(jax.tree.map(lambda x: x[None], going), each)
    return jax.tree.map(lambda x: x[0], found)


def log_likelihood(model: PPO, samples: Samples, deviation: float) -> Any:
    off = (samples.targets - model._weights.act(samples.inputs)) / deviation
    return (-0.5 * jnp.square(off) - np.log(deviation) - 0.5 * np.log(2.0 * np.pi)).sum(1)


def as_theirs(weights: Any) -> list[Any]:
    """Ours, or their gradients, as torch has them."""
    return [torch.from_numpy(np.array(each.T)) for layers in weights for layer in layers for each in layer]


def test_a_gradient_step_is_that_of_stable_baselines() -> None:
    model = make(persistence=0.0, privileged=False)
    settings: Any = model._settings
    other = theirs(model, settings)
    samples = collected(model, settings.deviation)
    buffer: Any = other.rollout_buffer
    for name, rows in {
        "observations": samples.inputs,
        "actions": samples.targets,
        "advantages": samples.advantages,
        "returns": samples.returns,
        "values": model._weights.worth(samples.inputs),
        "log_probs": log_likelihood(model, samples, settings.deviation),
    }.items():
        getattr(buffer, name)[:] = np.asarray(rows)[:, None]
    buffer.full = True
    other.train()
    gradient = jax.grad(loss_of)(model._weights, samples, settings.deviation, settings.clip, settings.value_weight)
    norm = np.sqrt(sum(float(jnp.square(each).sum()) for each in jax.tree.leaves(gradient)))
    clipped = jax.tree.map(lambda x: x * min(1.0, settings.max_gradient / norm), gradient)
    largest = max(float(jnp.abs(each).max()) for each in jax.tree.leaves(clipped))
    for ours, their in zip(as_theirs(clipped), layers_of(other.policy), strict=True):
        assert torch.allclose(ours, their.grad, rtol=0.0, atol=1e-5 * largest), "clipped gradients"

    def step(samples: Samples) -> Any:
        return descend(settings, model._weights, model._adam, samples, settings.deviation, settings.learning_rate)

    after, _, _ = jax.vmap(step, axis_name=PART)(jax.tree.map(lambda x: x[None], samples))
    for ours, their in zip(as_theirs(jax.tree.map(lambda x: x[0], after)), layers_of(other.policy), strict=True):
        assert torch.allclose(ours, their, rtol=0.0, atol=0.02 * settings.learning_rate), "Adam's first step"


def test_gradients_of_halves_add_up_to_that_of_the_whole() -> None:
    model = make()
    settings: Any = model._settings
    samples = collected(model, 0.3)

    def moments(samples: Samples) -> Any:
        return descend(settings, model._weights, model._adam, samples, 0.3, 1e-3)[1]

    found = [
        jax.vmap(moments, axis_name=PART)(jax.tree.map(lambda x, n=parts: x.reshape(n, -1, *x.shape[1:]), samples))
        for parts in (1, 2)
    ]
    for whole, halves in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(halves[0], whole[0], atol=1e-6)
        np.testing.assert_array_equal(halves[0], halves[1])


def test_advantages_are_those_of_stable_baselines() -> None:
    rng = np.random.default_rng(0)
    steps, worlds, discount = 12, 5, 0.97
    rewards, values = rng.normal(size=(steps, worlds)), rng.normal(size=(steps + 1, worlds))
    ends = rng.uniform(size=(steps, worlds)) < 0.2
    finals = np.where(ends & (rng.uniform(size=ends.shape) < 0.5), rng.normal(size=ends.shape), 0.0)
    buffer = RolloutBuffer(
        steps, spaces.Box(-1.0, 1.0, (1,)), spaces.Box(-1.0, 1.0, (1,)), "cpu", 0.9, discount, worlds
    )
    buffer.rewards[:] = rewards + discount * finals  # as it counts the value of a truncated episode's last state
    buffer.values[:] = values[:-1]
    buffer.episode_starts[1:] = ends[:-1]
    buffer.compute_returns_and_advantage(torch.as_tensor(values[-1], dtype=torch.float32), ends[-1])
    found = estimate(*map(jnp.asarray, (rewards, values, ends, finals)), discount, 0.9)
    np.testing.assert_allclose(found, buffer.advantages, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("persistence", [0.0, 0.85])
def test_the_likelihood_given_the_noise_before_is_exact(persistence: float) -> None:
    """The ratio is that of the densities of the actions given what was left of the noise, and 1 for the same policy."""
    model = make(persistence=persistence)
    samples = collected(model, 0.3)
    ones = samples._replace(advantages=jnp.ones_like(samples.advantages))
    assert float(loss_of(model._weights, ones, 0.3, 0.2, 0.0)) == pytest.approx(-1.0, abs=1e-5)
    before = log_likelihood(model, samples, 0.3)
    *first, (weight, bias) = model._weights.policy
    model._weights = model._weights._replace(policy=[*first, (weight, bias + 0.02)])
    ratio = jnp.exp(log_likelihood(model, samples, 0.3) - before)
    expected = -jnp.minimum(ratio, jnp.clip(ratio, 0.8, 1.2)).mean()
    assert float(loss_of(model._weights, ones, 0.3, 0.2, 0.0)) == pytest.approx(float(expected), rel=1e-4)


def test_the_noise_lasts_and_starts_again_with_an_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    model = make(persistence=0.85, worlds=512, steps=24, minibatch=12288, episode=12)
    model._weights = jax.tree.map(jnp.zeros_like, model._weights)
    given: list[np.ndarray] = []
    step = model._worlds.step

    def seen(shared: Any, state: Any, outputs: Any) -> Any:
        jax.debug.callback(lambda each: given.append(np.asarray(each)), outputs, ordered=False)
        return step(shared, state, outputs)

    monkeypatch.setattr(model._worlds, "step", seen)
    jax.block_until_ready(collected(model, 0.3))
    jax.effects_barrier()
    noise = np.array(given)
    lasting = (noise[1:] * noise[:-1]).mean(axis=(1, 2)) / (noise[:-1] ** 2).mean(axis=(1, 2))
    assert lasting[:10] == pytest.approx(0.85, abs=0.08)
    assert lasting[11] == pytest.approx(0.0, abs=0.08), "all episodes ended there"
    assert noise[0].std() == pytest.approx(0.3, abs=0.02)
    assert noise[11].std() == pytest.approx(0.3 * np.sqrt((1 - 0.85**24) / (1 - 0.85**2)), rel=0.05)


@pytest.mark.parametrize(("algorithm", "scenario", "held"), [("ppo", "everything", 3), ("residual", "everything", 1)])
def test_its_worlds_are_those_of_the_other_algorithms(algorithm: str, scenario: str, held: int) -> None:
    """But for the rounding of float32, at the size of an input's centre over its scale."""
    small = {**SMALL, "contexts": 32, "episode": 60, "frame_skip": held}
    settings = settings_from(algorithm, {**asdict(load_settings(algorithm)), **small})
    given = training.Arguments(
        algorithm=algorithm, scenario=scenario, pace="all", steps=1000, seed=2, settings=settings
    )
    draws = training.make_draws(given)
    worlds = training.make_training_worlds(given, draws, prepare.make_interface(settings, scenario, draws, 2))
    ours = JaxWorlds(worlds)
    shared = ours.shared
    of_policy = (LARGEST + np.abs(shared.present.center)) / shared.present.scale
    copies = 1 + len(settings.history) + len(settings.averages)
    of_value = (LARGEST + np.abs(shared.truth.center)) / shared.truth.scale
    tolerance = 2.0**-21 * np.concatenate([*[of_policy] * copies, of_value])
    step, inputs, last_inputs = jax.jit(ours.step), jax.jit(ours.inputs), jax.jit(ours.last_inputs)
    seeds = (np.arange(16, dtype=np.uint64) + 5).view(np.uint32).reshape(-1, 2)
    state = jax.jit(ours.reset)(shared, seeds)
    first = worlds.reset(5)
    assert (np.abs(inputs(state) - first) <= tolerance).all()
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(130):
        actions = rng.uniform(-1.2, 1.2, (16, 4)).astype(np.float32)
        expected, before = worlds.step(actions), state
        state, found = step(shared, state, actions)
        np.testing.assert_allclose(found.rewards, expected.rewards, rtol=1e-4, atol=1e-4)
        np.testing.assert_array_equal(found.terminated, expected.terminated)
        np.testing.assert_array_equal(found.truncated, expected.truncated)
        assert (np.abs(inputs(state) - expected.inputs) <= tolerance).all()
        last = np.asarray(last_inputs(shared, before, found.last_obs))[expected.ended]
        assert (np.abs(last - expected.last) <= tolerance).all()
        ended += len(expected.ended)
    assert ended >= 32
    worlds.close()


def test_deviation_and_learning_rate_fall_as_they_are_told() -> None:
    settings: Any = replace(
        load_settings("ppo"), deviation=0.4, deviation_end=0.1, exploring=0.5, learning_rate=1e-3, learning_rate_end=0.0
    )
    assert [settings.deviation_at(done) for done in (0.0, 0.5, 0.75, 1.0, 9.0)] == pytest.approx(
        [0.4, 0.4, 0.2, 0.1, 0.1]
    )
    assert [settings.learning_rate_at(done) for done in (0.0, 0.5, 1.0, 9.0)] == pytest.approx([1e-3, 5e-4, 0.0, 0.0])
    assert replace(settings, exploring=1.0).deviation_at(0.99) == 0.4


ALONE = """
import os, sys
if sys.argv[1] == "one":
    os.sched_setaffinity(0, list(os.sched_getaffinity(0))[:1])
sys.path[:0] = sys.argv[2:]
from agents.test_ppo import make
from pter_agents.ppo import _arrays
model = make()
for _ in range(3):
    model.advance()
print(hash(tuple(each.tobytes() for each in _arrays(model._weights))))
"""


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_cores() -> None:
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    one, every = (
        subprocess.check_output([sys.executable, "-c", ALONE, cores, *sys.path], env=environment)
        for cores in ("one", "every")
    )
    assert one == every
