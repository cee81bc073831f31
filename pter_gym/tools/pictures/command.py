"""``pter watch``: an episode of policies as a video, and as a table."""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from pter_gym._commands.arguments import MachineName, among, split
from pter_gym._internal.files import check_target
from pter_gym._internal.terminal import progress_bar, say
from pter_gym.errors import ParameterError
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario

if TYPE_CHECKING:
    from pter_gym.benchmark.simulation import Episode
    from pter_gym.params import Machine
    from pter_gym.scenarios import Scenario
    from pter_gym.tasks.path_following import PathFollowing

MOST_POLICIES = 16

WINDOW_RATE = 50


def watch(
    policies: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME,…")],
    scenario: Annotated[str, tyro.conf.arg(metavar="NAME"), among(lambda: SCENARIOS)] = "standard",
    pace: Annotated[str, tyro.conf.arg(metavar="NAME"), among(lambda: PACES)] = "medium",
    seed: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4|gif|png")] = None,
    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv|npz")] = None,
    size: Annotated[str | None, tyro.conf.arg(metavar="WIDTHxHEIGHT")] = None,
    speed: float = 1.0,
    machine: MachineName = None,
) -> None:
    """Watch policies side by side on the same episode.

    Opens a window, or writes a file with --out. The episode is a training draw of the scenario; the stored evaluation
    episodes are never read. A window and mp4 need the extra render.

    Example: pter watch torque-feedback,residual --out both.gif

    Args:
        policies: Separated by commas, as for `pter benchmark --scenario`.
        scenario: Scenario that draws the episode.
        pace: Commanded pace.
        seed: Seed of the episode, and of random and predictive policies, at least 0.
        out: Video to write, or with .png the final picture, with the tip's trail; its folder must exist.
        csv: File for the episode's whole telemetry; see docs/watching.md. Its folder must exist.
        size: Width and height of the picture in pixels.
        speed: Playback speed relative to real time; 0.2 is slow motion.
        machine: Clutch material, or the preset of a machine of your own, instead of the one that the scenario draws.
    """
    names = split(policies)
    check_arguments(names, out, csv, size, speed)
    drawn = find_scenario(scenario, machine)
    held, task = draw(drawn, pace, seed)
    episodes = simulate(names, scenario, held, task, seed, drawn.nominal)
    for name, episode in episodes.items():
        say(f"{name}: {summary(episode)}")
    if csv:
        from pter_gym.benchmark._trajectories import write_trajectories

        write_trajectories({name: episode.telemetry for name, episode in episodes.items()}, csv)
        say(f"wrote {csv}")
    if not out and csv:
        return
    from pter_gym.tools.pictures.render.film import RATES, film_of, frames_of, show_film, write_film

    shown = {name: episode.telemetry for name, episode in episodes.items()}
    rate = RATES[out.suffix.lower()] if out else WINDOW_RATE
    film = film_of(held, task, shown, rate, speed, parse_size(size))
    if not out:
        show_film(film, rate, f"PTER: {', '.join(episodes)}")
        return
    with progress_bar() as progress:
        bar = progress.add_task("draw", total=frames_of(film, out))
        write_film(film, out, lambda: progress.advance(bar))
    say(f"wrote {out}, {out.stat().st_size / 1e6:.2f} MB")


def check_arguments(names: list[str], out: Path | None, csv: Path | None, size: str | None, speed: float) -> None:
    """Check the arguments as far as possible before the simulation; errors name the argument."""
    from pter_gym.benchmark._trajectories import check_table

    if not 1 <= len(names) <= MOST_POLICIES:
        raise ParameterError(f"policies must be 1 to {MOST_POLICIES} names separated by commas, got {len(names)}")
    if not (math.isfinite(speed) and speed > 0.0):
        raise ParameterError(f"speed must be a number > 0, got {speed!r}")
    parse_size(size)
    for field, path in (("out", out), ("csv", csv)):
        if path:
            check_target(field, path)
    if csv:
        check_table(csv)
    if out:
        from pter_gym.tools.pictures.render.film import check_ending

        check_ending(out)
    elif not csv:
        from pter_gym.tools.pictures.render.window import has_display

        if not has_display():
            raise ParameterError("out must be given where there is no display, such as --out film.mp4; or --csv")


def parse_size(text: str | None) -> tuple[int, int] | None:
    """Return width and height [px], None for the default ones, or raise a ParameterError."""
    from pter_gym.envs._size import check_size

    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,6})[x×](\d{1,6})", text, re.ASCII)
    if not found:
        raise ParameterError(f"size must be WIDTHxHEIGHT in pixels, such as 1280x720, got {text!r}")
    return check_size(int(found[1]), int(found[2]))


def draw(scenario: "Scenario", pace: str, seed: int) -> "tuple[Machine, PathFollowing]":
    """Return machine and task of a scenario's first training draw from a seed."""
    from pter_gym._internal.checks import whole_number

    return scenario.randomisation(pace, contexts=1, seed=whole_number("seed", seed, at_least=0)).pairs()[0]


def simulate(
    names: list[str], scenario: str, machine: "Machine", task: "PathFollowing", seed: int, nominal: "Machine"
) -> "dict[str, Episode]":
    """Return the episode of each policy by its name."""
    from pter_gym.benchmark import find_policy
    from pter_gym.benchmark.simulation import record_episode, time_limit

    policies = {name: find_policy(name, seed, scenario) for name in names}
    episodes: dict[str, Episode] = {}
    with progress_bar() as progress:
        steps = time_limit(task)
        for name, policy in policies.items():
            bar = progress.add_task(f"simulate {name}", total=steps)
            episodes[name] = record_episode(
                policy, machine, task, seed, steps, nominal=nominal, on_step=lambda bar=bar: progress.advance(bar)
            )
            progress.update(bar, completed=steps)
    return episodes


def summary(episode: "Episode") -> str:
    """Return a summary of an episode in words."""
    from pter_gym.tasks.path_following import COLUMN

    telemetry: Any = episode.telemetry
    last = telemetry[-1]
    end = "arrived" if last[COLUMN.is_success] else "left the workspace" if last[COLUMN.terminated] else "time is up"
    error = 1e3 * abs(telemetry[:, COLUMN.normal_error])
    return f"{end} after {last[COLUMN.time]:.2f} s; error {error.mean():.1f} mm on average, {error.max():.1f} at most"
