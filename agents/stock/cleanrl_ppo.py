"""PPO in one file of torch, in the style and with the defaults of CleanRL: `python agents/stock/cleanrl_ppo.py`."""

from pathlib import Path
from types import SimpleNamespace

import gymnasium
import torch
import tyro
from gymnasium.wrappers.vector import NormalizeObservation, NormalizeReward
from torch import distributions, nn

from pter_gym.benchmark import ResultsFolder, find_policy, from_sb3, print_boards, run_scenario


def network(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    made = nn.Sequential(*[nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)])
    for k, g in ((0, 2.0**0.5), (2, 2.0**0.5), (4, gain)):
        nn.init.orthogonal_(made[k].weight, g), nn.init.zeros_(made[k].bias)
    return made


def train(seed: int = 0, steps: int = 5_000_000, n: int = 16, horizon: int = 2048, out: Path = Path("stock")) -> None:
    torch.manual_seed(seed), torch.set_num_threads(1)
    seen = NormalizeObservation(gymnasium.make_vec("PTER/Standard-v0", n, telemetry=False))
    envs, (size,) = NormalizeReward(seen, gamma=0.99), seen.single_observation_space.shape
    actor, critic, spread = network(size, 4, 0.01), network(size, 1, 1.0), nn.Parameter(torch.zeros(4))
    weights = [*actor.parameters(), *critic.parameters(), spread]
    adam, limited = torch.optim.Adam(weights, lr=3e-4, eps=1e-5), lambda x: torch.as_tensor(x).float().clamp(-10, 10)
    obs, idle = limited(envs.reset(seed=seed)[0]), torch.zeros(n)  # idle: the step in which a world begins anew
    for update in range(updates := steps // (n * horizon)):
        adam.param_groups[0]["lr"] = 3e-4 * (1.0 - update / updates)
        taken, gains, gain = [], [], torch.zeros(n)
        with torch.no_grad():
            for _ in range(horizon):
                acts, value = distributions.Normal(actor(obs), spread.exp()), critic(obs)[:, 0]
                act = acts.sample()
                after, pay, end, cut, _ = envs.step(act.clamp(-1, 1).numpy())
                taken.append((obs, act, acts.log_prob(act).sum(1), value, *map(limited, (pay, end, end | cut)), idle))
                obs, idle = limited(after), taken[-1][-2]
            after = critic(obs)[:, 0]
            for *_, value, pay, end, done, began in reversed(taken):
                gain = (1 - began) * (pay - value + 0.99 * ((1 - end) * after + 0.95 * (1 - done) * gain))
                after = value
                gains.append(gain)
        o, a, p, v, *_ = (torch.stack(part).flatten(0, 1) for part in zip(*taken, strict=True))
        g = torch.stack(gains[::-1]).flatten()
        for k in (part for _ in range(10) for part in torch.randperm(n * horizon).chunk(32)):
            ratio = (distributions.Normal(actor(o[k]), spread.exp()).log_prob(a[k]).sum(1) - p[k]).exp()
            better, moved = (g[k] - g[k].mean()) / (g[k].std() + 1e-8), critic(o[k])[:, 0] - v[k]
            surprise = torch.maximum((moved - g[k]) ** 2, (moved.clamp(-0.2, 0.2) - g[k]) ** 2).mean()
            loss = torch.maximum(-better * ratio, -better * ratio.clamp(0.8, 1.2)).mean() + 0.25 * surprise
            adam.zero_grad(), loss.backward(), nn.utils.clip_grad_norm_(weights, 0.5), adam.step()
    spaces = {"observation_space": envs.single_observation_space, "action_space": envs.single_action_space}
    model = SimpleNamespace(**spaces, predict=lambda obs, **_: (actor(limited(obs)).detach().numpy(), None))
    policies = {f"cleanrl-ppo-{seed}": from_sb3(model, seen), "torque-feedback": find_policy("torque-feedback")}
    print_boards(run_scenario("standard", policies, seed=seed, results=ResultsFolder(out)))


if __name__ == "__main__":
    tyro.cli(train)
