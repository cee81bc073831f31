"""``pter watch``: an episode of policies as a film, and as a table."""

import math
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import tyro

from pter_gym._commands.arguments import (
    AnyPace,
    HandName,
    MachineName,
    PathName,
    ScenarioName,
    Smoothness,
    look_at,
    options,
    scenario_on,
    smoothing_for,
)
from pter_gym._commands.terminal import conclude, progress_bar, say, waiting
from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import check_target
from pter_gym.errors import ParameterError
from pter_gym.policies.find import split
from pter_gym.tools.pictures.size import check_size

MAX_POLICIES = 16


def watch(
    policies: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME,…")] = "",
    scenario: ScenarioName = "standard",
    pace: AnyPace = "medium",
    path: PathName = None,
    smooth: Smoothness = 0.0,
    seed: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.webp|mp4|png")] = None,
    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None,
    size: Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="WIDTH HEIGHT")] = None,
    speed: float = 1.0,
    machine: MachineName = None,
    hand: HandName = None,
    worst: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None,
) -> None:
    """Watch policies side by side on the same episode.

    Opens a window, or writes a file with --out. The episode is a training episode of the
    scenario, or with --worst that of the worst hand. A window and mp4 need the extra render.

    Example: pter watch torque-feedback,residual --out both.webp

    Args:
        policies: Separated by commas, as for `pter benchmark --policies`.
        scenario: Scenario of the episode.
        pace: Commanded pace: slow, medium, brisk, or a speed in m/s.
        path: Path instead of the scenario's: a CSV file of waypoints x, y in metres, or a path's
            name.
        smooth: Noise to remove from a recorded path, root mean square, in mm.
        seed: Seed of the episode, and of random policies, at least 0.
        out: Film to write, or with .png the final picture, with the tip's trail; its folder must
            exist.
        csv: File for the episode's whole telemetry; see docs/watching.md. Its folder must exist.
        size: Width and height of the picture in pixels.
        speed: Playback speed relative to real time; 0.2 is slow motion.
        machine: Name or file of a machine, instead of the scenario's.
        hand: Name or file of a hand, instead of the scenario's; of a file of `pter identify
            --hand`, all hands that fit the log. See docs/hands.md.
        worst: Results of `pter benchmark --worst` with the worst hand for the first policy.
    """
    names = split(policies)
    look_at(
        policies=names or [""], paces=[pace], path=path, smooth=smooth, machine=machine, hand=hand
    )

    from pter_gym.benchmark import ResultsFolder, find_policy
    from pter_gym.benchmark.results import write_trajectories
    from pter_gym.benchmark.rollout import record_episode
    from pter_gym.tools.pictures import film

    check_arguments(names, out, csv, size, speed)
    seed = whole_number("seed", seed, at_least=0)
    definition = scenario_on(scenario, machine, path, smooth, hand)
    if worst:
        found = ResultsFolder(worst).worst_hand(names[0], definition, pace)
        machine_of_episode, task, seed = found.machine, found.task, 0
    else:
        machine_of_episode, task = definition.draws.pairs(1, seed, pace)[0]
    by_name = {name: find_policy(name, definition.whose_gains) for name in names}
    telemetry: dict[str, Any] = {}
    with waiting("simulating"):
        for name, policy in by_name.items():
            telemetry[name] = record_episode(
                policy, machine_of_episode, task, seed, nominal=definition.nominal
            ).telemetry
            say(f"{name}: {summary_of(telemetry[name])}")
    smooth = smooth or smoothing_for(definition)
    same = options(
        scenario=scenario, pace=pace, path=path, machine=machine, hand=hand, smooth=smooth
    )
    following = f"pter benchmark --policies {quote(','.join(names))}{same}"
    if csv:
        write_trajectories(telemetry, csv)
    if out:
        with progress_bar() as progress:
            bar = progress.add_task("drawing", total=1.0)
            film.write_film(
                machine_of_episode,
                task,
                telemetry,
                out,
                speed=speed,
                size=size,
                on_progress=lambda share: progress.update(bar, completed=share),
            )
    elif not csv:
        film.show_film(
            film.Film(machine_of_episode, task, telemetry, film.WINDOW_RATE, speed, size),
            f"PTER: {', '.join(by_name)}",
        )
    conclude([file for file in (csv, out) if file], following)


def check_arguments(
    names: list[str], out: Path | None, csv: Path | None, size: tuple[int, int] | None, speed: float
) -> None:
    """Check the arguments as far as possible before the simulation; errors name the argument."""
    from pter_gym.benchmark.results import check_csv
    from pter_gym.tools.pictures import film, viewer

    if not 1 <= len(names) <= MAX_POLICIES:
        raise ParameterError(
            f"policies must be 1 to {MAX_POLICIES} names separated by commas, got {len(names)}"
        )
    if not (math.isfinite(speed) and speed > 0.0):
        raise ParameterError(f"speed must be a number > 0, got {speed!r}")
    if size is not None:
        check_size(*size)
    for field, path, check in (("out", out, film.check_suffix), ("csv", csv, check_csv)):
        if path:
            check_target(field, path)
            check(path)
    if not out and not csv and viewer.open_display().display.get_driver() in viewer.INVISIBLE:
        raise ParameterError(
            "out must be given where a window would not be seen, such as --out film.webp; or --csv"
        )


def summary_of(telemetry: Any) -> str:
    """Return how an episode ended, and how far the tip was from the path, in words."""
    from pter_gym.tasks.path_following import COLUMN
    from pter_gym.tools.pictures.drawing import outcome

    last = telemetry[-1]
    ending = outcome(last) if last[COLUMN.terminated] else "time is up"
    error = 1e3 * abs(telemetry[:, COLUMN.normal_error])
    return (
        f"{ending} after {last[COLUMN.time]:.2f} s; "
        f"error {error.mean():.1f} mm on average, {error.max():.1f} at most"
    )
