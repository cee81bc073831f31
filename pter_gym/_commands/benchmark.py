"""``pter benchmark``: policies ranked on a scenario, or in the paper's standard test."""

import json
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from pter_gym._commands.arguments import IS_MACHINE, Check, among, numbers, split
from pter_gym._internal.plugins import PICTURES, load_artist, registered
from pter_gym._internal.terminal import make_folder, progress_bar, say, terminal
from pter_gym.errors import ParameterError
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario

if TYPE_CHECKING:
    from pter_gym.benchmark import Result, Score
    from pter_gym.benchmark.simulation import AnyPolicy
    from pter_gym.scenarios import Scenario

POLICIES = "residual,single-dof-tuned,torque-feedback,impedance"
"""Policies on a scenario: the trained one, the best tuned law, and the paper's two controllers."""

PAPER = "paper"
"""What ``--scenario`` calls the paper's standard test."""

PAPER_POLICIES = "residual,torque-feedback,impedance"
TIME_CONSTANTS = "0.01,0.03,0.06,0.105,0.15,0.2"
MACHINE = "baseline"
DERIVED = "derived"
PACE = "medium"
"""Pace of the film, if it is among those that are run."""

FILM = ".webp"

FILMED = 4
"""Most policies in a film."""


def check_fresh(field: str, text: str) -> None:
    """Raise a ParameterError unless a text is how fresh episodes are asked for."""
    if text != DERIVED and not (text.isascii() and text.isdigit() and int(text) < 1 << 64):
        raise ParameterError(f"{field} must be a whole number within [0, 2⁶⁴) or the word {DERIVED}, got {text!r:.200}")


def benchmark(
    policies: Annotated[str | None, tyro.conf.arg(metavar="NAME,…")] = None,
    scenario: Annotated[str, tyro.conf.arg(metavar="NAME"), among(lambda: (*SCENARIOS, PAPER))] = "standard",
    paces: Annotated[str, tyro.conf.arg(metavar="NAME,…"), among(lambda: PACES, several=True)] = ",".join(PACES),
    episodes: Annotated[int | None, tyro.conf.arg(metavar="COUNT")] = None,
    fresh: Annotated[str | None, tyro.conf.arg(metavar="SEED|derived"), Check(check_fresh)] = None,
    machine: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.toml"), IS_MACHINE] = MACHINE,
    time_constants: Annotated[str, tyro.conf.arg(metavar="SECONDS,…")] = TIME_CONSTANTS,
    seed: int = 0,
    isolated: bool = False,
    film: bool = True,
    out: Path = Path("pter-benchmark"),
) -> None:
    """Rank policies on a scenario, and film them side by side.

    Prints a leaderboard for each pace, and writes benchmark.json, a file for each run, pictures, and a film of up to
    four policies. Runs that are already in the folder are not repeated; several benchmarks may share a folder. The
    paper's standard test prints a table and writes benchmark.json, tip_paths.png (as in the paper's Fig. 11) and
    error_against_time.png. Each picture is also written as vector graphics, .pdf.

    Example: pter benchmark --policies residual,impedance-tuned --episodes 20

    Args:
        policies: Names separated by commas; paths of exported policies; package.module:attribute for your own. By
            default the trained policy residual, the best tuned law and the paper's two controllers.
        scenario: Scenario whose stored evaluation episodes are run, or paper for the paper's standard test.
        paces: Commanded paces of a scenario, separated by commas.
        episodes: How many of the scenario's episodes to run; all by default. Ranks from fewer than 200 are provisional.
        fresh: Seed of fresh episodes, as many as the stored ones; policies that are code run on them isolated, and only
            once. With derived, each policy has its own episodes, whose seed follows from its content, the code and
            the scenario, so it cannot be tuned to them. By default the stored episodes are run.
        machine: Clutch material of the standard test, or the preset of a machine of your own.
        time_constants: Time constants of the standard test's clutches [s], separated by commas; one episode each.
        seed: Seed of the standard test's episodes, and of the random policy, at least 0.
        isolated: Whether each policy that is code runs in a separate process; see docs/trust.md.
        film: Whether to film the policies on a training draw of the scenario.
        out: Folder for the results, created if necessary.
    """
    if scenario == PAPER:
        on_scenario = {"paces": split(paces) != list(PACES), "episodes": episodes, "fresh": fresh, "isolated": isolated}
        refuse(on_scenario, f"another scenario than {PAPER}")
        names = split(PAPER_POLICIES if policies is None else policies)
        standard_test(names, machine, numbers("time_constants", time_constants), seed, out)
    else:
        in_test = {"machine": machine != MACHINE, "time_constants": time_constants != TIME_CONSTANTS}
        refuse(in_test, f"--scenario {PAPER}: other scenarios have machines of their own")
        names = split(POLICIES if policies is None else policies)
        scenario_benchmark(scenario, names, split(paces), episodes, fresh, seed, out, isolated=isolated, film=film)


def refuse(given: Mapping[str, object], needed: str) -> None:
    """Raise a ParameterError that names an argument that was given where it has no meaning."""
    for name, value in given.items():
        if value is not None and value is not False:
            raise ParameterError(f"{name} needs {needed}")


def standard_test(names: list[str], machine: str, seconds: list[float], seed: int, out: Path) -> None:
    """Run the paper's standard test on controllers, print its table and write its results to a folder."""
    from pter_gym.benchmark import run_standard_test
    from pter_gym.benchmark._naming import find_policy
    from pter_gym.scenarios._own_machine import as_sensed, find_own
    from pter_gym.tasks.path_following import PathFollowing

    chosen = {name: find_policy(name, seed, scenario=None) for name in names}
    own = find_own(machine)
    goal = as_sensed(PathFollowing(), own)
    make_folder(out)
    with progress_bar() as progress:
        task = progress.add_task("standard test", total=None)
        result = run_standard_test(
            chosen,
            machine=own.machine,
            task=goal,
            time_constants=seconds,
            seed=seed,
            on_progress=lambda _: progress.update(task, total=len(chosen), advance=1),
        )
    try:
        with terminal(errors=True).status("drawing"):
            written = write_result(result, out)
    finally:
        terminal().print(scores_table(result))
    for path in written:
        say(f"wrote {path}")


def scenario_benchmark(
    scenario: str,
    names: list[str],
    paces: list[str],
    episodes: int | None,
    fresh: str | None,
    seed: int,
    out: Path,
    *,
    isolated: bool,
    film: bool,
) -> None:
    """Run controllers on a scenario's evaluation episodes, print its leaderboards and write its results to a folder."""
    from pter_gym.benchmark import Isolated, ResultsFolder, find_policy, run_scenario
    from pter_gym.benchmark._gaps import find_gaps, gap_tables
    from pter_gym.benchmark._naming import is_code
    from pter_gym.benchmark.leaderboard import table

    drawn = find_scenario(scenario)
    results = ResultsFolder(out)
    ridden = int(fresh) if fresh and fresh.isdigit() else fresh
    isolated = isolated or isinstance(ridden, int)
    with ExitStack() as processes, progress_bar() as progress:

        def find(name: str) -> "AnyPolicy":
            if isolated and is_code(name):
                return processes.enter_context(Isolated(name))
            return find_policy(name, seed, scenario)

        policies = {name: find(name) for name in names}
        task = progress.add_task(scenario, total=None)
        runs = run_scenario(
            scenario,
            policies,
            paces,
            episodes=episodes,
            fresh=ridden,
            results=results,
            on_progress=lambda _: progress.update(task, total=len(names) * len(paces), advance=1),
        )
        progress.remove_task(task)
        boards = [board for board in results.summarise() if board.has_episodes_of(runs[0])]
        contents = results.read()
        for board in boards:
            terminal().print(table(board), "")
        for gaps in gap_tables([gap for gap in find_gaps(contents.runs) if gap.scenario == scenario]):
            terminal().print(gaps, "")
        for left in contents.left_out:
            say(f"left out {left.file}: {left.reason}")
        task = progress.add_task("drawing", total=None)
        written = [results.summary, *pictures_of("scenario", boards, contents.runs, out)]
        if film and "film" in registered(PICTURES):
            shown = {name: policies[name] for name in names[:FILMED]}
            written.append(film_policies(shown, drawn, PACE if PACE in paces else paces[0], seed, out, progress))
    for path in written:
        say(f"wrote {path}")


def film_policies(
    policies: "Mapping[str, AnyPolicy]", scenario: "Scenario", pace: str, seed: int, out: Path, progress: Progress
) -> Path:
    """Film policies side by side on a training draw into a folder; return the path."""
    from pter_gym.benchmark.simulation import record_episode, time_limit

    artist = load_artist("film")
    ((machine, goal),) = scenario.randomisation(pace, contexts=1, seed=seed).pairs()
    limit = time_limit(goal)
    films = {
        name: record_episode(policy, machine, goal, seed, limit, nominal=scenario.nominal).telemetry
        for name, policy in policies.items()
    }
    task = progress.add_task("filming", total=1.0)
    path = out / f"{scenario.name}-{pace}{FILM}"
    artist.write_film(machine, goal, films, path, on_progress=lambda share: progress.update(task, completed=share))
    return path


COLUMNS: "Mapping[str, Callable[[Score], str]]" = MappingProxyType(
    {
        "path\nerror\n\\[mm]": lambda s: f"{1000 * s.path_error_m:.1f}" if s.completed else "–",
        "mean\nerror\n\\[mm]": lambda s: f"{1000 * s.mean_error_m:.1f}",
        "mean\nspeed\n\\[m/s]": lambda s: f"{s.mean_speed_m_s:.3f}",
        "mean\nacc.\n\\[m/s²]": lambda s: f"{s.mean_acceleration_m_s2:.2f}",
        "peak\nacc.\n\\[m/s²]": lambda s: f"{s.peak_acceleration_m_s2:.2f}",
        "way\n\n\\[m]": lambda s: f"{s.path_length_m:.3f}",
        "time\n\n\\[s]": lambda s: f"{s.duration_s:.2f}",
        "brake\nwork\n\\[J]": lambda s: f"{s.dissipated_j:.2f}",
    }
)
"""The scores of the standard test that are printed, by the titles of their columns."""


def scores_table(result: "Result") -> Table:
    """Return a table with one row per policy and time constant, in SI; it fits a terminal of 80 columns."""
    from pter_gym.benchmark._measures import column
    from pter_gym.benchmark.leaderboard import plain_table

    table = plain_table(
        f"The paper's standard test, seed {result.seed}",
        ["policy", "τ\n\n\\[s]", "got to\n\n\\[%]", *COLUMNS],
        caption="got to: part of the path; path error: at equal pace, of those that arrive; docs/scoring.md says how",
    )
    for name, runs in result.runs.items():
        for k, run in enumerate(runs):
            share = min(float(column(run.telemetry, "arc_length").max()) / result.task.path.length, 1.0)
            texts = [text(run.score) for text in COLUMNS.values()]
            table.add_row(escape(name) if k == 0 else "", f"{run.time_constant:g}", f"{100 * share:.3g}", *texts)
        table.add_row()
    return table


def write_result(result: "Result", out: Path) -> list[Path]:
    """Write ``benchmark.json`` and the pictures to a folder that exists; return their paths."""
    from pter_gym._internal.files import write_text_atomic

    scores = out / "benchmark.json"
    write_text_atomic(scores, json.dumps(result.as_json(), indent=2) + "\n")
    return [scores, *pictures_of("standard-test", result, out)]


def pictures_of(name: str, *drawn: Any) -> list[Path]:
    """Return the paths of the pictures that are drawn, none where nothing that draws them is installed."""
    artist = registered(PICTURES).get(name)
    return artist.load()(*drawn) if artist else []
