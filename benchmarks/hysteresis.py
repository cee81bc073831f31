"""Path errors of policies on PTER without and with hysteresis of its clutches.

    python benchmarks/hysteresis.py [POLICY …]

prints, for 24 training episodes of `standard` at each pace, the lines of the table in
docs/devices.md: means in mm, without hysteresis and with ±5 % of the largest voltage.
"""

from dataclasses import replace

import tyro

from pter_gym.benchmark import evaluate, find_policy, training_episodes
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES, find_scenario

POLICIES = ("single-dof-tuned", "residual", "universal")
SHARES = (0.0, 0.05)
EPISODES, SEED = 24, 7


def errors(policy: str, share: float) -> list[str]:
    """Return mean path errors [mm] at all paces, with a share of the largest voltage."""
    clutch = BASELINE.clutch
    machine = replace(BASELINE, clutch=replace(clutch, hysteresis=share * clutch.voltage_max))
    scenario, found = find_scenario("standard", machine), []
    for pace in PACES:
        episodes = training_episodes(scenario, pace, EPISODES, SEED)
        scores = evaluate(find_policy(policy, "standard"), episodes)
        found.append(f"{1e3 * scores['path_error_m'].mean():.1f}")
    return found


def main(policies: tyro.conf.Positional[tuple[str, ...]] = POLICIES) -> None:
    """Print a line for each policy."""
    for policy in policies:
        cells = (" / ".join(errors(policy, share)) for share in SHARES)
        print(f"| `{policy}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
