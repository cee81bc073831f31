"""Whether promises hold: machines with hidden numbers are logged, identified and then scored.

    python benchmarks/promise.py [MACHINES]

For each of 20 machines: its log as docs/identify.md records it, what identification finds, the
promise for ``impedance`` on the scenario ``standard``, and the hidden machine's own score on the
episodes of the promise. Takes about half a minute for each.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracle.experiment import Experiment, record_log
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.rollout import evaluate
from pter_gym.params import BASELINE, Machine
from pter_gym.tools.device.promise import SEED, make_promise
from pter_gym.tools.identification import identify

SCENARIO, PACE, LAW, EPISODES = "standard", "medium", "impedance", 4
SHORT = Experiment(levels=(4.0, 8.0, 12.0, 16.0, 20.0, 22.0), on=0.9, off=0.25, free=4.0)


def hidden(seed: int) -> Machine:
    """Return a machine with other inertias, friction, torques and lag, within ±25 %."""
    rng = np.random.default_rng([seed, 74])
    a, b, c, slope, lag = rng.uniform(0.75, 1.25, 5)
    arm, clutch = BASELINE.arm, BASELINE.clutch
    dynamic = replace(clutch.dynamic, slope=slope * clutch.dynamic.slope)
    return replace(
        BASELINE,
        arm=replace(
            arm,
            inertia_a=a * arm.inertia_a,
            inertia_b=b * arm.inertia_b,
            coupling=c * arm.coupling,
            dry_a=float(rng.uniform(0.1, 0.5)),
            dry_b=float(rng.uniform(0.1, 0.5)),
        ),
        clutch=replace(
            clutch,
            dynamic=dynamic,
            breakaway=dynamic.scaled(float(rng.uniform(1.05, 1.3))),
            time_constant=lag * clutch.time_constant,
        ),
        clutch_scale=tuple(rng.uniform(0.9, 1.1, 4).tolist()),
    )


def main(count: int) -> None:
    """Print a row for each machine, and on how many the promise holds."""
    policy, held, described = find_policy(LAW, SCENARIO), 0, 0
    for seed in range(count):
        machine = hidden(seed)
        found = identify(record_log(machine, SHORT, seed=seed), BASELINE)
        machines = found.machines
        if isinstance(machines, Machine):
            print(f"{seed:2d} {found.verdict.grade}", flush=True)
            continue
        promise = make_promise(policy, LAW, machines, SCENARIO, PACE, episodes=EPISODES)
        some = find_episodes(SCENARIO, PACE, SEED, machines.machine).first(EPISODES)
        point, own = (
            float(evaluate(policy, replace(some, machines=(m,) * EPISODES))["path_error_m"].mean())
            for m in (machines.machine, machine)
        )
        held, described = held + (own <= promise.error_m), described + 1
        print(
            f"{seed:2d} {found.verdict.grade}: promised {1e3 * promise.error_m:.3f} mm, "
            f"hidden {1e3 * own:.3f} mm, estimate {1e3 * point:.3f} mm, ranks on "
            f"{100 * promise.ranked:.0f} %",
            flush=True,
        )
    print(f"holds on {held} of {described}, {count - described} without a promise")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
