"""``pter benchmark``: policies ranked on a scenario."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import tyro

from pter_gym._commands.arguments import (
    ALL,
    AnyPaces,
    AnyScenario,
    HandName,
    MachineName,
    PathName,
    Smoothness,
    look_at,
    options,
    scenario_on,
    smoothing_for,
)
from pter_gym._commands.terminal import conclude, progress_bar, say
from pter_gym.errors import ParameterError
from pter_gym.plugins import PICTURES, load_artist, registered
from pter_gym.policies.find import split
from pter_gym.scenarios import PACES, SCENARIOS

if TYPE_CHECKING:
    from rich.progress import Progress

    from pter_gym.benchmark import Leaderboard, ResultsFolder
    from pter_gym.controllers import AnyPolicy
    from pter_gym.scenarios import Scenario

USUAL_POLICIES = ("residual", "single-dof-tuned", "torque-feedback", "impedance")
"""The trained policy, the best tuned law, and the paper's two controllers."""

ON_A_MACHINE = ("universal", *USUAL_POLICIES[1:])
"""The same with the policy for any machine, on one of the user's."""

WHERE_CLUTCHES_FAIL = ("universal", "residual", "single-dof-tuned")
"""The policies for any machine and for this one, and the best tuned law."""

FILM_PACE = "medium"
"""Pace of the film, if it is among those that are run."""

FILM_SUFFIX = ".webp"

MAX_FILMED = 4
"""Most policies in a film."""


@dataclass(frozen=True)
class Benchmark:
    """Rank policies on a scenario, and film them.

    Prints their path errors at each pace, the best policy first. Writes benchmark.json, a file for
    each run, pictures, and a film: the errors of up to four policies, and the arm under the best
    and the worst of them. Several benchmarks may share a folder; only the present one is printed
    and drawn. With all scenarios there is no film.

    Example: pter benchmark --policies residual impedance-tuned --episodes 20

    Args:
        policies: Names of laws and trained policies, paths of exported ones, of gains from `pter
            tune` or of a table of voltages (.csv), or FILE.py:attribute or package.module:attribute
            for your own; any of these with +detector goes on without a clutch that fails. Commas
            may separate them too. With --machine, the default is universal instead of residual.
        scenario: Scenario whose test episodes are run, or all.
        paces: Commanded paces: slow, medium, brisk, or speeds in m/s.
        path: Path of all episodes instead of the scenario's: a CSV file of waypoints x, y in
            metres, or a path's name.
        smooth: Noise to remove from a recorded path, root mean square, in mm.
        episodes: How many of the scenario's episodes to run; all by default.
        seed: Draw as many other test episodes with this seed; by default, the stored ones are run,
            or with --path or --machine, where there are none, those of seed 0.
        details: Also print the mean of the worst 5 %, rms, pace and peak acceleration.
        worst: Also search for the hand that pushes the arm furthest off the path under each policy,
            and print its path error and an upper bound on how often a worse hand occurs. Takes
            12,288 episodes for each policy and pace.
        faults: Also run the episodes with each clutch dead, with half of its torque, and stuck at a
            quarter of the largest voltage, and print the path errors and how many arrive. Takes
            twelve times as many episodes more. By default, of universal, residual and
            single-dof-tuned.
        film: Whether to film the policies on a training episode of the scenario.
        out: Folder for the results, created if necessary.
        machine: Name or file of a machine, instead of the scenario's.
        hand: Name or file of a hand, instead of the scenario's; of a file of `pter identify
            --hand`, all hands that fit the log. See docs/hands.md.
        table: File for one table of all scenarios and paces, its best numbers bold: Markdown, LaTeX
            or CSV.
        baseline: Policy to which the table gives differences, with 95 % intervals over the same
            episodes.
    """

    policies: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME …")] = USUAL_POLICIES
    scenario: AnyScenario = "standard"
    paces: AnyPaces = tuple(PACES)
    path: PathName = None
    smooth: Smoothness = 0.0
    episodes: Annotated[int | None, tyro.conf.arg(metavar="COUNT")] = None
    seed: Annotated[int | None, tyro.conf.arg(metavar="NUMBER")] = None
    details: bool = False
    worst: bool = False
    faults: bool = False
    film: bool = True
    out: Path = Path("pter-benchmark")
    machine: MachineName = None
    hand: HandName = None
    table: Annotated[Path | None, tyro.conf.arg(metavar="FILE.md|.tex|.csv")] = None
    baseline: str | None = None

    def __call__(self) -> None:
        """Run the episodes, print and write what they show, and say how to go on."""
        self.check()
        from pter_gym.benchmark import ResultsFolder
        from pter_gym.benchmark.tables import check_table

        if self.table is not None:
            check_table(self.table)
        scenarios = [
            scenario_on(name, self.machine, self.path, self.smooth, self.hand)
            for name in self.scenario_names
        ]
        results = ResultsFolder(self.out)
        results.make()
        with progress_bar() as progress:
            boards = [self.rank(scenario, results, progress) for scenario in scenarios]
            files = [results.summary, *self.tabulate(boards)]
            progress.add_task("drawing", total=None)
            healthy = [[board for board in each if not board.failures] for each in boards]
            files += [file for each in healthy for file in draw_boards(each, results.path)]
            if self.film and len(scenarios) == 1 and "film" in registered(PICTURES):
                files.append(self.film_ranked(scenarios[0], healthy[0], results.path, progress))
        conclude(files, self.next_command(scenarios[0], healthy[0]))

    @property
    def scenario_names(self) -> tuple[str, ...]:
        """The scenarios, one by one."""
        return tuple(SCENARIOS) if self.scenario == ALL else (self.scenario,)

    @property
    def names(self) -> list[str]:
        """The policies, one by one."""
        names = self.policies
        if names == USUAL_POLICIES and self.machine is not None:
            names = ON_A_MACHINE
        elif names == USUAL_POLICIES and self.faults:
            names = WHERE_CLUTCHES_FAIL
        return [name for each in names for name in split(each)]

    def check(self) -> None:
        """Raise a ParameterError if options do not fit together or name what is not there."""
        names = self.names
        if self.path is not None and self.scenario == ALL:
            raise ParameterError(
                f"path must be given with one scenario, got {self.path!r} with all"
            )
        if self.baseline is not None and (self.table is None or self.baseline not in names):
            needed = f"among {', '.join(names)}, with a table"
            raise ParameterError(f"baseline must be {needed}, got {self.baseline!r}")
        look_at(
            policies=names,
            paces=self.paces,
            path=self.path,
            smooth=self.smooth,
            machine=self.machine,
            hand=self.hand,
        )

    def rank(
        self, scenario: "Scenario", results: "ResultsFolder", progress: "Progress"
    ) -> "Sequence[Leaderboard]":
        """Run the policies on a scenario; print and return the leaderboards of its episodes."""
        from pter_gym.benchmark import find_policy, leaderboards, run_scenario
        from pter_gym.benchmark.boards import boards_text, others_text
        from pter_gym.benchmark.faults import faults, faults_text

        names = self.names
        kinds = 1 + len(faults(scenario.nominal)) * self.faults
        task = progress.add_task(scenario.name, total=len(names) * len(self.paces) * kinds)
        runs = run_scenario(
            scenario,
            {name: find_policy(name, scenario.whose_gains) for name in names},
            self.paces,
            episodes=self.episodes,
            seed=self.seed,
            results=results,
            worst=self.worst,
            faults=self.faults,
            on_progress=lambda _: progress.advance(task),
        )
        progress.remove_task(task)
        boards = leaderboards(runs)
        healthy = [board for board in boards if not board.failures]
        say(boards_text(healthy, details=self.details))
        if self.faults:
            say(faults_text(boards))
        results.summarise()
        if others := others_text(results.runs(), runs):
            say(others)
        return boards

    def tabulate(self, boards: "Sequence[Sequence[Leaderboard]]") -> list[Path]:
        """Write the table of all scenarios, if one is wanted; return its path."""
        from pter_gym.benchmark.tables import write_table

        if self.table is None:
            return []
        command = shlex.join(["pter", *sys.argv[1:]])
        every = [board for each in boards for board in each]
        return [write_table(self.table, every, baseline=self.baseline, command=command)]

    def film_ranked(
        self,
        scenario: "Scenario",
        boards: "Sequence[Leaderboard]",
        folder: Path,
        progress: "Progress",
    ) -> Path:
        """Film the first policies, the best first, at one of the paces; return the film's path."""
        from pter_gym.benchmark import find_policy
        from pter_gym.benchmark.boards import in_order

        pace = FILM_PACE if FILM_PACE in (board.pace for board in boards) else boards[0].pace
        places = list(in_order([board for board in boards if board.pace == pace]))
        filmed = sorted(self.names[:MAX_FILMED], key=places.index)
        policies = {name: find_policy(name, scenario.whose_gains) for name in filmed}
        return film_policies(policies, scenario, pace, folder, progress)

    def next_command(self, scenario: "Scenario", boards: "Sequence[Leaderboard]") -> str:
        """Return the command that shows the best policy on a scenario beside the last one."""
        from pter_gym.benchmark.boards import in_order

        best, *others = in_order(boards)
        smooth = self.smooth or smoothing_for(scenario)
        same = options(
            scenario=self.scenario_names[0],
            path=self.path,
            machine=self.machine,
            hand=self.hand,
            smooth=smooth,
        )
        same += f" --worst {quote(str(self.out))}" if self.worst else ""
        return f"pter watch {quote(','.join([best, *others[-1:]]))}{same} --out two.webp"


def draw_boards(boards: "Sequence[Leaderboard]", folder: Path) -> list[Path]:
    """Draw leaderboards into a folder, if what draws them is installed; return the files."""
    artist = registered(PICTURES).get("scenario")
    return artist.load()(boards, folder) if artist else []


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
