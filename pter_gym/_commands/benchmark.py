"""``pter benchmark``: policies ranked on a scenario."""

from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import tyro

from pter_gym._commands.arguments import (
    AnyPaces,
    MachineName,
    PathName,
    ScenarioName,
    Smoothness,
    look_at,
    options,
    scenario_on,
    smoothing_for,
    split,
)
from pter_gym._internal.plugins import PICTURES, load_artist, registered
from pter_gym._internal.terminal import conclude, progress_bar, say
from pter_gym.scenarios import PACES

if TYPE_CHECKING:
    from rich.progress import Progress

    from pter_gym.controllers import AnyPolicy
    from pter_gym.scenarios import Scenario

POLICIES = ("residual", "single-dof-tuned", "torque-feedback", "impedance")
"""The trained policy, the best tuned law, and the paper's two controllers."""

FILM_PACE = "medium"
"""Pace of the film, if it is among those that are run."""

FILM_SUFFIX = ".webp"

MAX_FILMED = 4
"""Most policies in a film."""


def benchmark(
    policies: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME …")] = POLICIES,
    scenario: ScenarioName = "standard",
    paces: AnyPaces = tuple(PACES),
    path: PathName = None,
    smooth: Smoothness = 0.0,
    episodes: Annotated[int | None, tyro.conf.arg(metavar="COUNT")] = None,
    seed: Annotated[int | None, tyro.conf.arg(metavar="NUMBER")] = None,
    details: bool = False,
    worst: bool = False,
    film: bool = True,
    out: Path = Path("pter-benchmark"),
    machine: MachineName = None,
) -> None:
    """Rank policies on a scenario, and film them.

    Prints their path errors at each pace, the best policy first. Writes benchmark.json, a file for
    each run, pictures, and a film: the errors of up to four policies, and the arm under the best
    and the last of them. Several benchmarks may share a folder.

    Example: pter benchmark --policies residual impedance-tuned --episodes 20

    Args:
        policies: Names of laws and trained policies, paths of exported ones or of gains from
            `pter tune`, or FILE.py:attribute or package.module:attribute for your own. Commas may
            separate them too.
        scenario: Scenario whose test episodes are run.
        paces: Commanded paces: slow, medium, brisk, or speeds in m/s.
        path: Path of all episodes instead of the scenario's: a CSV file of waypoints x, y in
            metres, or a path's name.
        smooth: Noise to remove from a recorded path, root mean square, in mm.
        episodes: How many of the scenario's episodes to run; all by default.
        seed: Draw as many other test episodes with this seed; by default, the stored ones are run,
            or with --path or --machine, where there are none, those of seed 0.
        details: Also print the worst twentieth, rms, pace and peak acceleration.
        worst: Also search for the hand that pushes each policy furthest off the path, and print its
            path error, and how rare a worse hand is at most. Takes 12,288 episodes for each policy
            and pace.
        film: Whether to film the policies on a training episode of the scenario.
        out: Folder for the results, created if necessary.
        machine: Name or file of a machine, instead of those that the scenario draws.
    """
    names = [name for each in policies for name in split(each)]
    look_at(policies=names, paces=paces, path=path, smooth=smooth, machine=machine)

    from pter_gym.benchmark import ResultsFolder, find_policy, run_scenario
    from pter_gym.benchmark.boards import EPISODE_SET, boards_text, in_order

    definition = scenario_on(scenario, machine, path, smooth)
    results = ResultsFolder(out)
    results.make()
    policies_by_name = {name: find_policy(name, definition.whose_gains) for name in names}
    with progress_bar() as progress:
        task = progress.add_task(definition.name, total=len(policies_by_name) * len(paces))
        runs = run_scenario(
            definition,
            policies_by_name,
            paces,
            episodes=episodes,
            seed=seed,
            results=results,
            worst=worst,
            on_progress=lambda _: progress.advance(task),
        )
        progress.remove_task(task)
        boards = [
            board for board in results.summarise() if EPISODE_SET(board) == EPISODE_SET(runs[0])
        ]
        say(boards_text(boards, details=details))
        progress.add_task("drawing", total=None)
        files = [results.summary]
        if artist := registered(PICTURES).get("scenario"):
            files += artist.load()(boards, results.path)
        if film and "film" in registered(PICTURES):
            pace = FILM_PACE if FILM_PACE in (run.pace for run in runs) else runs[0].pace
            places = list(in_order([board for board in boards if board.pace == pace]))
            filmed = sorted(list(policies_by_name)[:MAX_FILMED], key=places.index)
            ranked = {name: policies_by_name[name] for name in filmed}
            files.append(film_policies(ranked, definition, pace, results.path, progress))
    best, *others = in_order(boards)
    smooth = smooth or smoothing_for(definition)
    same = options(scenario=scenario, path=path, machine=machine, smooth=smooth)
    ends = quote(",".join([best, *others[-1:]]))
    same += f" --worst {quote(str(out))}" if worst else ""
    conclude(files, f"pter watch {ends}{same} --out two.webp")


def film_policies(
    policies: "Mapping[str, AnyPolicy]",
    scenario: "Scenario",
    pace: str,
    folder: Path,
    progress: "Progress",
) -> Path:
    """Film policies, the best first, on a training episode into a folder; return the path."""
    from pter_gym.benchmark.rollout import record_episode

    artist = load_artist("film")
    ((machine, goal),) = scenario.draws.pairs(1, 0, pace)
    episodes = {
        name: record_episode(policy, machine, goal, 0, nominal=scenario.nominal).telemetry
        for name, policy in policies.items()
    }
    path = folder / f"{scenario.name}-{pace}{FILM_SUFFIX}"
    task = progress.add_task("filming", total=1.0)

    def show(share: float) -> None:
        progress.update(task, completed=share)

    names = list(episodes)
    artist.write_film(machine, goal, episodes, path, arms=(names[0], names[-1]), on_progress=show)
    return path
