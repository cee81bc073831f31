"""Policies on devices that no training has seen: laws tuned for each, a scaled law, networks.

    python benchmarks/devices.py tune
    python benchmarks/devices.py table [POLICY …]
    python benchmarks/devices.py choose POLICY …

``tune`` writes the laws tuned for each device into benchmarks/devices, but those that are there,
about two minutes of CPU for each of twelve; ``table`` scores these and others on the test episodes
of `standard`. Seeds of one policy are given as NAME=PATH,PATH,…. ``choose`` says which seed to
ship: it scores on training draws of 60 devices from the distribution of ``pter train universal``.
docs/development/any-device.md has the table.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import tyro

from pter_agents.draws import DEVICES
from pter_gym.benchmark import assess, evaluate, find_policy, training_episodes
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.rollout import Assessment
from pter_gym.controllers import AnyPolicy
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, TorqueCurve
from pter_gym.policies.tuned import SCALED, read_gains, read_tuned
from pter_gym.scenarios import PACES
from pter_gym.tools.device.data_sheet import find_device, machine_of_sheet
from pter_gym.tools.tuning.gains_file import add_gains
from pter_gym.tools.tuning.search import tune as search

HERE = Path(__file__).parent / "devices"
LAWS = ("single-dof", "velocity-ratio")
TRIALS = 300

FRESH, EPISODES = 2**32, 20
"""Seed of the devices to choose on, that of no training, and episodes for each and each pace."""


def big_arm() -> Machine:
    """Longer, heavier links, three strong clutches that stick and drag."""
    arm, torque, off = BASELINE.arm, 100.0, 3.0
    curve = TorqueCurve(slope=(torque - off) / 24.0, knee=24.0, curvature=0.0, off_state=off)
    clutch = replace(
        BASELINE.clutch, dynamic=curve, breakaway=curve.scaled(1.3), time_constant=0.06
    )
    heavier = {name: 2.0 * getattr(arm, name) for name in ("inertia_a", "inertia_b", "coupling")}
    longer = {name: 1.3 * getattr(arm, name) for name in ("length_a", "length_b")}
    return replace(
        BASELINE,
        arm=replace(arm, **heavier, **longer),
        clutch=clutch,
        clutch_scale=(1.0, 1.0, 1.0, 0.0),
    )


def devices() -> dict[str, Machine]:
    """The four: two of ACTUATORS, a fast weak brake, and ``big_arm``."""
    found = {name: find_device(name) for name in ("particle-brake", "delrin-clutch")}
    weak = machine_of_sheet(torque=20.0, at=12.0, lag=0.015)
    return {**found, "weak-and-fast": weak, "big-arm": big_arm()}


def tune_for(machines: dict[str, Machine], trials: int = TRIALS) -> None:
    """Tune laws for machines, and write the gains that are not there yet."""
    HERE.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        for name, machine in machines.items():
            for law in LAWS:
                file = HERE / f"{name}-{law}.toml"
                there = read_gains(file).get("standard", {}).get(law, {})
                for pace in (pace for pace in PACES if pace not in there):
                    found = search(
                        law,
                        "standard",
                        pace,
                        trials=trials,
                        machine=machine,
                        storage=Path(folder, f"{name}.journal"),
                    )
                    add_gains(replace(found, machine=None), file)
                    print(name, law, pace, found.assessment, flush=True)


def tune(only: Annotated[tuple[str, ...], tyro.conf.Positional] = ()) -> None:
    """Tune laws for devices, by default for all."""
    tune_for({name: machine for name, machine in devices().items() if name in (only or devices())})


def best_law(name: str, pace: str) -> AnyPolicy:
    """Return the law tuned for a device that is best on training episodes."""
    if name == "PTER":
        return find_policy("single-dof-tuned")

    def value(law: str) -> float:
        (by_law,) = read_gains(HERE / f"{name}-{law}.toml").values()
        entry = by_law[law][pace]
        return Assessment(*(entry[field] for field in Assessment._fields)).value

    return read_tuned(HERE / f"{name}-{min(LAWS, key=value)}.toml").at(PACES[pace])


def scored(policy: AnyPolicy, machine: Machine, pace: str) -> tuple[float, float]:
    """Return mean path error [mm] and share of arrivals [%] on the test episodes of `standard`."""
    scores = evaluate(policy, find_episodes("standard", pace, machine=machine), ranking=True)
    return 1e3 * float(scores["path_error_m"].mean()), 100.0 * float(scores["completed"].mean())


def told(policy: AnyPolicy, machine: Machine, pace: str) -> str:
    try:
        error, arrived = scored(policy, machine, pace)
    except ParameterError:  # made for another largest voltage
        return "–"
    return f"{error:.1f}" if arrived > 99.95 else f"{error:.1f} ({arrived:.0f} %)"


def table(
    policies: Annotated[tuple[str, ...], tyro.conf.Positional] = (SCALED, "residual"),
) -> None:
    """Print path errors [mm] by device and pace, PTER last, and how many arrive if not all do.

    A policy given as NAME=PATH,PATH,… is one of several seeds, of which the median is shown first.
    """
    columns = {name: paths or name for name, _, paths in (each.partition("=") for each in policies)}
    print(f"| Device | Pace | tuned there | {' | '.join(columns)} |")
    print("|---|---|" + "---:|" * (1 + len(columns)))
    for name, machine in {**devices(), "PTER": BASELINE}.items():
        for pace in PACES:
            cells = [told(best_law(name, pace), machine, pace)]
            for paths in columns.values():
                seeds = [told(find_policy(path), machine, pace) for path in paths.split(",")]
                middle = seeds[0]
                if len(seeds) > 1:
                    order = sorted(seeds, key=lambda cell: float(cell.split()[0]))
                    middle = order[len(seeds) // 2]
                cells.append(middle if len(seeds) == 1 else f"{middle} ({', '.join(seeds)})")
            print(f"| {name} | {pace} | {' | '.join(cells)} |", flush=True)


def choose(policies: Annotated[tuple[str, ...], tyro.conf.Positional], devices: int = 60) -> None:
    """Print geometric means over drawn devices and paces of what ``pter tune`` minimises."""
    rng = np.random.default_rng(FRESH)
    machines = [DEVICES.draw(rng) for _ in range(devices)]
    for name in policies:
        policy, values = find_policy(name), list[float]()
        for pace in PACES:
            for machine in machines:
                try:
                    episodes = training_episodes("standard", pace, EPISODES, FRESH, machine)
                except ParameterError:  # its path is out of reach
                    continue
                values.append(min(assess([policy], episodes).value, 1.0))
        good = 100.0 * float(np.mean(np.array(values) < 0.1))
        mean = 1e3 * float(np.exp(np.mean(np.log(values))))
        print(f"{name}: {mean:.2f} mm, {good:.0f} % below 100 mm, {len(values)} pairs", flush=True)


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"tune": tune, "table": table, "choose": choose})
