"""``pter device``: what a device can render, and how well laws tuned for it do."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import tyro

from pter_gym._commands.arguments import PaceName, look_at
from pter_gym._internal.plugins import COMMANDS, registered
from pter_gym._internal.terminal import conclude, say, waiting


def device(
    machine: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME|FILE.toml")],
    pace: PaceName = "medium",
    trials: int = 200,
    episodes: int = 100,
    train: bool = False,
    out: Path = Path("pter-device"),
) -> None:
    """Examine a device: its forces, its walls, and how well laws tuned for it guide a hand.

    Tunes a law on each of the scenarios standard, corridor and wall, and scores it on fresh
    episodes. Writes index.html, device.json and pictures. Needs the extras tune and render.

    Example: pter device particle-brake --out particle-brake

    Args:
        machine: A machine or an actuator by its name, or the file of your own.
        pace: Commanded pace.
        trials: Gains to try for each law.
        episodes: Fresh episodes of each scenario, at most as many as it has stored ones.
        train: Also train a policy by PPO for the machine, and compare it with the laws. Needs the
            extra agents.
        out: Folder for the results, created if necessary.
    """
    look_at(machine=machine)

    from pter_gym.tools.device.report import examine_device

    policies = {"ppo": _trained(machine, pace, out)} if train else {}
    with waiting("starting") as progress:
        (task,) = progress.task_ids
        report = examine_device(
            machine,
            out,
            name=Path(machine).stem,
            pace=pace,
            trials=trials,
            episodes=episodes,
            policies=policies,
            on_progress=lambda text: progress.update(task, description=text),
        )
    say(f"{report.device}: {report.verdict}")
    for board in report.boards:
        best = board.standings[0]
        say(f"{board.scenario}: {best.policy} {1e3 * best.error.value:.1f} mm")
    watched = f"pter watch single-dof-tuned,residual --machine {quote(machine)} --out two.webp"
    conclude([out / "index.html"], watched)


def _trained(machine: str, pace: str, out: Path) -> Any:
    """Train a policy for a machine in a folder, and return it."""
    from pter_gym.benchmark import find_policy

    commands = registered(COMMANDS)
    run, policy = out / "training", out / "ppo"
    commands["train"].load()("ppo", pace=pace, machine=machine, out=run)
    commands["export"].load()(str(run), out=policy, name="ppo")
    return find_policy(policy)
