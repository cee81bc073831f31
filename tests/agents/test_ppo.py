"""The loop of our own: its gradients are Stable-Baselines3's, its likelihood is exact, its noise lasts."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.agents

torch = pytest.importorskip("torch")
algorithms = pytest.importorskip("stable_baselines3")

from gymnasium import spaces  # noqa: E402
from stable_baselines3.common.buffers import RolloutBuffer  # noqa: E402
from stable_baselines3.common.logger import Logger  # noqa: E402

from pter_agents import prepare, training  # noqa: E402
from pter_agents.algorithms import load_settings, settings_from  # noqa: E402
from pter_agents.ppo import PARTS, PPO, Samples, estimate, loss_of, with_even_advantages  # noqa: E402

SMALL = {"worlds": 16, "steps": 32, "minibatch": 512, "epochs": 1, "contexts": 4, "episode": 25}


def make(**changes: Any) -> PPO:
    settings = settings_from("ppo", {**asdict(load_settings("ppo")), **SMALL, **changes})
    given = training.Arguments(
        algorithm="ppo", scenario="standard", pace="all", steps=1_000_000, seed=2, settings=settings
    )
    draws = training.make_draws(given)
    interface = prepare.make_interface(settings, "standard", draws, 2)
    model: Any = training.make_model(given, training.make_parts(given, draws, interface))
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
        ours = [*model.networks.parameters()]
        for target, source in zip(layers_of(policy), ours, strict=True):
            target.copy_(source)
    policy.log_std.requires_grad_(False)
    found.set_logger(Logger(None, []))
    return found


def layers_of(policy: Any) -> list[Any]:
    """Weights of the other's networks in the order of ours."""
    both = (policy.mlp_extractor.policy_net, policy.action_net), (policy.mlp_extractor.value_net, policy.value_net)
    return [weight for body, head in both for part in (body, head) for weight in part.parameters()]


def test_a_gradient_step_is_that_of_stable_baselines() -> None:
    model = make(persistence=0.0, privileged=False)
    settings: Any = model._settings
    other = theirs(model, settings)
    collected = [part.collect(model.networks, settings.deviation) for part in model._parts]
    samples = with_even_advantages(collected)
    every = Samples(*(torch.cat(rows) for rows in zip(*samples, strict=True)))
    buffer: Any = other.rollout_buffer
    with torch.no_grad():
        values = model.networks.worth(every.inputs)
        likelihood = torch.distributions.Normal(model.networks.act(every.inputs), settings.deviation)
        logs = likelihood.log_prob(every.targets).sum(1)
    for name, rows in {
        "observations": every.inputs,
        "actions": every.targets,
        "advantages": every.advantages,
        "returns": every.returns,
        "values": values,
        "log_probs": logs,
    }.items():
        getattr(buffer, name)[:] = rows.numpy()[:, None]
    buffer.full = True
    before = [weight.detach().clone() for weight in model._weights]
    other.train()
    model._adam.param_groups[0]["lr"] = settings.learning_rate
    model._learn(samples, settings.deviation)
    moved = max(float((a - b).detach().abs().max()) for a, b in zip(model._weights, before, strict=True))
    assert moved == pytest.approx(settings.learning_rate, rel=0.01), "Adam's first step is the learning rate"
    largest = max(float(weight.grad.abs().max()) for weight in model._weights)
    for ours, their in zip(model._weights, layers_of(other.policy), strict=True):
        assert torch.allclose(ours.grad, their.grad, rtol=0.0, atol=1e-5 * largest), "clipped gradients"
    model.close()


def test_gradients_of_halves_add_up_to_that_of_the_whole() -> None:
    model = make()
    samples = with_even_advantages([part.collect(model.networks, 0.3) for part in model._parts])
    every = Samples(*(torch.cat(rows) for rows in zip(*samples, strict=True)))
    _, whole = model._gradient(every, 0.3)
    halves = [model._gradient(part, 0.3)[1] for part in samples]
    for weight, *parts in zip(whole, *halves, strict=True):
        assert torch.allclose(weight, sum(parts[1:], parts[0]) / PARTS, atol=1e-6)
    model.close()


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
    single = [np.asarray(each, np.float32) for each in (rewards, values)]
    found = estimate(*single, ends, finals.astype(np.float32), discount, 0.9)
    np.testing.assert_allclose(found, buffer.advantages, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("persistence", [0.0, 0.85])
def test_the_likelihood_given_the_noise_before_is_exact(persistence: float) -> None:
    """The ratio is that of the densities of the actions given what was left of the noise, and 1 for the same policy."""
    model = make(persistence=persistence)
    part = model._parts[0]
    samples = part.collect(model.networks, 0.3)
    ones = samples._replace(advantages=torch.ones_like(samples.advantages))
    with torch.no_grad():
        assert float(loss_of(model.networks, ones, 0.3, 0.2, 0.0)) == pytest.approx(-1.0, abs=1e-5)
        before = torch.distributions.Normal(model.networks.act(samples.inputs), 0.3).log_prob(samples.targets).sum(1)
        model.networks.policy[-1].bias += 0.02
        after = torch.distributions.Normal(model.networks.act(samples.inputs), 0.3).log_prob(samples.targets).sum(1)
        ratio = torch.exp(after - before)
        found = float(loss_of(model.networks, ones, 0.3, 0.2, 0.0))
    expected = -torch.minimum(ratio, ratio.clamp(0.8, 1.2)).mean()
    assert found == pytest.approx(float(expected), rel=1e-4)
    model.close()


def test_the_noise_lasts_and_starts_again_with_an_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    model = make(persistence=0.85, worlds=512, steps=24, minibatch=12288, episode=12)
    part = model._parts[0]
    given: list[np.ndarray] = []
    step = part.worlds.step
    monkeypatch.setattr(part.worlds, "step", lambda outputs: given.append(outputs.copy()) or step(outputs))
    with torch.no_grad():
        for weight in model.networks.policy.parameters():
            weight.zero_()
    part.collect(model.networks, 0.3)
    noise = np.array(given)
    lasting = (noise[1:] * noise[:-1]).mean(axis=(1, 2)) / (noise[:-1] ** 2).mean(axis=(1, 2))
    assert lasting[:10] == pytest.approx(0.85, abs=0.08)
    assert lasting[11] == pytest.approx(0.0, abs=0.08), "all episodes ended there"
    assert noise[0].std() == pytest.approx(0.3, abs=0.02)
    assert noise[11].std() == pytest.approx(0.3 * np.sqrt((1 - 0.85**24) / (1 - 0.85**2)), rel=0.05)
    model.close()


def test_deviation_and_learning_rate_fall_as_they_are_told() -> None:
    settings: Any = replace(
        load_settings("ppo"), deviation=0.4, deviation_end=0.1, exploring=0.5, learning_rate=1e-3, learning_rate_end=0.0
    )
    assert [settings.deviation_at(done) for done in (0.0, 0.5, 0.75, 1.0, 9.0)] == pytest.approx(
        [0.4, 0.4, 0.2, 0.1, 0.1]
    )
    assert [settings.learning_rate_at(done) for done in (0.0, 0.5, 1.0, 9.0)] == pytest.approx([1e-3, 5e-4, 0.0, 0.0])
    assert replace(settings, exploring=1.0).deviation_at(0.99) == 0.4


def test_the_result_does_not_depend_on_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    def one_after_the_other(_: PPO, do: Any, over: Any) -> list[Any]:
        return [do(each) for each in over]

    def trained() -> list[np.ndarray]:
        model = make()
        for _ in range(3):
            model.advance()
        model.close()
        return [weight.detach().numpy().copy() for weight in model._weights]

    threaded = trained()
    monkeypatch.setattr(PPO, "_each", one_after_the_other)
    for one, other in zip(trained(), threaded, strict=True):
        assert one.tobytes() == other.tobytes()
