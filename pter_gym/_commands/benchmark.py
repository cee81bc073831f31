"""``pter benchmark``: policies ranked on a scenario."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import tyro

from pter_gym._commands.arguments import (
    ALL,
    AnyPaces,
    AnyScenario,
    MachineName,
    PathName,
    Smoothness,
    look_at,
    options,
    scenario_on,
    smoothing_for,
)
from pter_gym._internal.plugins import PICTURES, load_artist, registered
from pter_gym._internal.terminal import conclude, progress_bar, say
from pter_gym.errors import ParameterError
from pter_gym.policies.find import split
from pter_gym.scenarios import PACES, SCENARIOS

if TYPE_CHECKING:
    from rich.progress import Progress

    from pter_gym.benchmark import Leaderboard
    from pter_gym.controllers import AnyPolicy
    from pter_gym.scenarios import Scenario

POLICIES = ("residual", "single-dof-tuned", "torque-feedback", "impedance")
"""The trained policy, the best tuned law, and the paper's two controllers."""

ON_A_MACHINE = ("universal", *POLICIES[1:])
"""The same with the policy for any machine, on one of the user's."""

FILM_PACE = "medium"
"""Pace of the film, if it is among those that are run."""

FILM_SUFFIX = ".webp"

MAX_FILMED = 4
"""Most policies in a film."""


def benchmark(
    policies: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME …")] = POLICIES,
    scenario: AnyScenario = "standard",
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
    table: Annotated[Path | None, tyro.conf.arg(metavar="FILE.md|.tex|.csv")] = None,
    baseline: str | None = None,
) -> None:
    """Rank policies on a scenario, and film them.

    Prints their path errors at each pace, the best policy first. Writes benchmark.json, a file for
    each run, pictures, and a film: the errors of up to four policies, and the arm under the best
    and the last of them. Several benchmarks may share a folder; what is printed and drawn is
    of this one. With all scenarios there is no
    film.

    Example: pter benchmark --policies residual impedance-tuned --episodes 20

    Args:
        policies: Names of laws and trained policies, paths of exported ones or of gains from
            `pter tune`, or FILE.py:attribute or package.module:attribute for your own. Commas may
            separate them too. With --machine, universal is in the place of residual by default.
        scenario: Scenario whose test episodes are run, or all.
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
        table: File for one table of all scenarios and paces, its best numbers bold: Markdown, LaTeX
            or CSV.
        baseline: Policy to which the table gives differences, with 95 % intervals over the same
            episodes.
    """
    if machine is not None and policies == POLICIES:
        policies = ON_A_MACHINE
    names = [name for each in policies for name in split(each)]
    if path is not None and scenario == ALL:
        raise ParameterError(f"path must be given with one scenario, got {path!r} with all")
    if baseline is not None and (table is None or baseline not in names):
        needed = f"among {', '.join(names)}, with a table"
        raise ParameterError(f"baseline must be {needed}, got {baseline!r}")
    look_at(policies=names, paces=paces, path=path, smooth=smooth, machine=machine)

    from pter_gym.benchmark import ResultsFolder, find_policy, leaderboards, run_scenario
    from pter_gym.benchmark.boards import boards_text, in_order, others_text
    from pter_gym.benchmark.tables import check_table, write_table

    if table is not None:
        check_table(table)
    chosen = tuple(SCENARIOS) if scenario == ALL else (scenario,)
    definitions = [scenario_on(each, machine, path, smooth) for each in chosen]
    results = ResultsFolder(out)
    results.make()
    by_scenario: list[Sequence[Leaderboard]] = []
    files = [results.summary]
    with progress_bar() as progress:
        for definition in definitions:
            task = progress.add_task(definition.name, total=len(names) * len(paces))
            runs = run_scenario(
                definition,
                {name: find_policy(name, definition.whose_gains) for name in names},
                paces,
                episodes=episodes,
                seed=seed,
                results=results,
                worst=worst,
                on_progress=lambda _, task=task: progress.advance(task),
            )
            progress.remove_task(task)
            results.summarise()
            boards = leaderboards(runs)
            say(boards_text(boards, details=details))
            if others := others_text(results.runs(), runs):
                say(others)
            by_scenario.append(boards)
        if table is not None:
            every = [board for boards in by_scenario for board in boards]
            command = shlex.join(["pter", *sys.argv[1:]])
            files.append(write_table(table, every, baseline=baseline, command=command))
        progress.add_task("drawing", total=None)
        if artist := registered(PICTURES).get("scenario"):
            draw = artist.load()
            files += [file for boards in by_scenario for file in draw(boards, results.path)]
        boards, definition = by_scenario[0], definitions[0]
        if film and len(chosen) == 1 and "film" in registered(PICTURES):
            pace = FILM_PACE if FILM_PACE in (board.pace for board in boards) else boards[0].pace
            places = list(in_order([board for board in boards if board.pace == pace]))
            filmed = sorted(names[:MAX_FILMED], key=places.index)
            ranked = {name: find_policy(name, definition.whose_gains) for name in filmed}
            files.append(film_policies(ranked, definition, pace, results.path, progress))
    best, *others = in_order(boards)
    smooth = smooth or smoothing_for(definition)
    same = options(scenario=chosen[0], path=path, machine=machine, smooth=smooth)
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
