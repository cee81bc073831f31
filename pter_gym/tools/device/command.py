"""``pter device``: what a device can render, and how well laws tuned for it do."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from pter_gym._commands.arguments import HandName, PaceName, look_at, options
from pter_gym._commands.terminal import conclude, say, waiting
from pter_gym._internal.files import make_folder
from pter_gym.errors import ParameterError
from pter_gym.params import ACTUATORS, MACHINES
from pter_gym.plugins import COMMANDS, registered

if TYPE_CHECKING:
    from pter_gym.benchmark import Leaderboard


def device(
    machine: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME|FILE.toml")] = "",
    torque: float | None = None,
    at: float | None = None,
    off: float | None = None,
    lag: float | None = None,
    hysteresis: float | None = None,
    pace: PaceName = "medium",
    trials: int = 200,
    episodes: int = 100,
    train: bool = False,
    hand: HandName = None,
    out: Path = Path("pter-device"),
) -> None:
    """Examine a device: its forces, its walls, and how well laws tuned for it guide a hand.

    The device is a machine, or PTER with four clutches from a data sheet. For a machine or a hand
    from `pter identify`, it also says what holds for all that fit the log.

    Tunes a law on each of the scenarios standard, corridor and wall, and scores it on test
    episodes, on standard beside the policy for any device, also where a clutch fails. Writes
    index.html, device.json and pictures. Needs the extra tune.

    Example: pter device particle-brake --out particle-brake

    Args:
        machine: Name of a machine or of a clutch, or a file, which may hold just a table [clutch]
            with the numbers of a data sheet below, torque and at also as lists.
        torque: Torque of a clutch [N·m] at the voltage --at, instead of PTER's.
        at: Its largest voltage [V], or current [A].
        off: Its torque without voltage [N·m].
        lag: Time constant of its torque [s].
        hysteresis: Its hysteresis, over the largest voltage: 0.05 for ±5 %.
        pace: Commanded pace.
        trials: Gains to try for each law.
        episodes: Test episodes of each scenario, at most as many as are stored.
        train: Also train a policy by PPO for the machine, and compare it with the laws. Needs the
            extra agents.
        hand: Name or file of the hand to guide, instead of the scenarios'; of a file of `pter
            identify --hand`, all hands that fit the log. See docs/hands.md.
        out: Folder for the results, created if necessary.
    """
    look_at(hand=hand)
    sheet = {"torque": torque, "at": at, "off": off, "lag": lag, "hysteresis": hysteresis}
    is_sheet = any(number is not None for number in sheet.values())
    if is_sheet == bool(machine):
        raise ParameterError(
            "machine must be a name or a file, or left out with "
            f"{', '.join(f'--{each}' for each in sheet)}; "
            f"names are {', '.join((*MACHINES, *ACTUATORS))}"
        )
    from pter_gym.tools.device.data_sheet import find_device, machine_of_sheet

    own = machine_of_sheet(**sheet) if is_sheet else find_device(machine)

    from pter_gym.benchmark.faults import faults_text
    from pter_gym.params import save_machine
    from pter_gym.tools.device.report import SCENARIOS, UNIVERSAL, examine_device
    from pter_gym.tools.tuning.search import load_optuna

    load_optuna()
    make_folder(out)
    file = out / "machine.toml"
    save_machine(own, file, origin="chosen: given to pter device")
    policies = {"ppo": _trained(file, pace, hand, out)} if train else {}
    with waiting("starting") as progress:
        (task,) = progress.task_ids
        report = examine_device(
            own,
            out,
            name=title_of(machine, torque, at),
            pace=pace,
            trials=trials,
            episodes=episodes,
            policies=policies,
            hand=hand,
            on_progress=lambda text: progress.update(task, description=text),
        )
    say(f"{report.device}: {report.verdict}")
    for promise in report.promises:
        say(promise.sentence)
    for board in report.boards:
        say(f"{board.scenario}, path errors: {errors(board)}")
        gains = gains_in_words(report.gains[board.scenario])
        say(f"  gains of {SCENARIOS[board.scenario]}-tuned: {gains}")
        for each in board.standings:
            if each.worst:
                say(each.worst.sentence(each.policy))
    say(faults_text(report.whole_and_failing))
    names = {each.policy for board in report.boards for each in board.standings}
    filmed = ",".join(["single-dof-tuned", *sorted(names & {UNIVERSAL})])
    on = options(machine=str(file), hand=hand)
    watched = f"pter watch {filmed}{on} --out film.webp"
    conclude([out / "index.html", file], watched)


def title_of(machine: str, torque: float | None, at: float | None) -> str:
    """Return what a page calls a device: its name, the folder of its file, or its data sheet."""
    file = Path(machine)
    if machine:
        return file.parent.name if file.stem == "machine" and file.parent.name else file.stem
    numbers = [f"{torque:g} N·m" if torque else "PTER's torque", f" at {at:g} V" if at else ""]
    return f"a clutch of {''.join(numbers)}"


def gains_in_words(gains: dict[str, float | bool]) -> str:
    """Return the gains that a search has found."""
    return ", ".join(
        f"{name} {gain if isinstance(gain, bool) else f'{gain:.4g}'}"
        for name, gain in gains.items()
    )


def errors(board: "Leaderboard") -> str:
    """Return the path error of each policy in words, the best first, and which is not ranked."""
    return ", ".join(
        f"{each.policy} {1e3 * each.error.value:.1f} mm{'' if each.rank else f' ({each.reason})'}"
        for each in board.standings
    )


def _trained(file: Path, pace: str, hand: str | None, out: Path) -> Any:
    """Train a policy for the machine of a file, and a hand, in a folder, and return it."""
    from pter_gym.benchmark import find_policy

    commands = registered(COMMANDS)
    run, policy = out / "training", out / "ppo"
    commands["train"].load()("ppo", pace=pace, machine=str(file), hand=hand, out=run)
    commands["export"].load()(str(run), out=policy, name="ppo")
    return find_policy(policy)
