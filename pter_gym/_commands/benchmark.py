"""``pter benchmark``: controllers on the paper's standard test, or ranked on a scenario."""

import json
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.markup import escape
from rich.table import Table

from pter_gym._commands.arguments import numbers, split
from pter_gym._internal.plugins import PICTURES, registered
from pter_gym._internal.terminal import make_folder, progress_bar, say, terminal
from pter_gym.errors import ParameterError

if TYPE_CHECKING:
    from pter_gym.benchmark import Result, Score
    from pter_gym.benchmark.simulation import AnyPolicy

POLICIES = "impedance,torque-feedback,free,locked,random"
TIME_CONSTANTS = "0.01,0.03,0.06,0.105,0.15,0.2"
MACHINE = "baseline"
PACES = "slow,medium,brisk"


def benchmark(
    policies: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = POLICIES,
    scenario: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    paces: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = PACES,
    episodes: Annotated[int | None, tyro.conf.arg(metavar="COUNT")] = None,
    fresh: Annotated[str | None, tyro.conf.arg(metavar="SEED|derived")] = None,
    machine: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.toml")] = MACHINE,
    time_constants: Annotated[str, tyro.conf.arg(metavar="SECONDS,…")] = TIME_CONSTANTS,
    seed: int = 0,
    isolated: bool = False,
    out: Path = Path("pter-benchmark"),
) -> None:
    """Compare policies in the paper's standard test, or rank them.

    The standard test prints a table and writes benchmark.json, tip_paths.png (as in the paper's Fig. 11) and
    error_against_time.png. A scenario prints a leaderboard for each pace and writes benchmark.json, a file for each run
    and pictures. Runs that are already in the folder are not repeated; several benchmarks may share a folder. Each
    picture is also written as vector graphics, .pdf.

    Example: pter benchmark --scenario standard --policies residual --episodes 20

    Args:
        policies: Names separated by commas, tuned ones and planners only on a scenario; paths of exported policies;
            package.module:attribute for your own.
        scenario: Scenario whose stored evaluation episodes are run; the paper's standard test by default.
        paces: Commanded paces of a scenario, separated by commas.
        episodes: How many of the scenario's episodes to run; all by default. Ranks from fewer than 200 are provisional.
        fresh: Seed of fresh episodes, as many as the stored ones; policies that are code ride them isolated, and once.
            Or derived: each policy has episodes of its own, whose seed follows from its content, the code and the
            scenario, so nobody can tune to them. By default the stored episodes are run.
        machine: Clutch material of the standard test, or the preset of a machine of your own.
        time_constants: Time constants of the standard test's clutches [s], separated by commas; one episode each.
        seed: Seed of the standard test's episodes, and of random and predictive policies, at least 0.
        isolated: Whether each policy that is code runs in a process of its own; see docs/trust.md.
        out: Folder for the results, created if necessary.
    """
    if scenario is None:
        on_scenario = {"paces": paces != PACES, "episodes": episodes, "fresh": fresh, "isolated": isolated}
        refuse(on_scenario, "--scenario")
        standard_test(split(policies), machine, numbers("time_constants", time_constants), seed, out)
    else:
        in_test = {"machine": machine != MACHINE, "time_constants": time_constants != TIME_CONSTANTS}
        refuse(in_test, "no --scenario: it has machines of its own")
        scenario_benchmark(scenario, split(policies), split(paces), episodes, fresh, seed, out, isolated=isolated)


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
        task = progress.add_task("standard test", total=len(chosen))
        result = run_standard_test(
            chosen,
            machine=own.machine,
            task=goal,
            time_constants=seconds,
            seed=seed,
            on_progress=lambda _: progress.advance(task),
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
) -> None:
    """Run controllers on a scenario's evaluation episodes, print its leaderboards and write its results to a folder."""
    from pter_gym.benchmark import Isolated, ResultsFolder, find_policy, run_scenario
    from pter_gym.benchmark._gaps import find_gaps, gap_tables
    from pter_gym.benchmark._naming import is_code
    from pter_gym.benchmark.leaderboard import table

    results = ResultsFolder(out)
    ridden = fresh_number(fresh)
    isolated = isolated or isinstance(ridden, int)
    with ExitStack() as processes, progress_bar() as progress:

        def find(name: str) -> "AnyPolicy":
            if isolated and is_code(name):
                return processes.enter_context(Isolated(name))
            return find_policy(name, seed, scenario)

        policies = {name: find(name) for name in names}
        task = progress.add_task(scenario, total=len(names) * len(paces))
        runs = run_scenario(
            scenario,
            policies,
            paces,
            episodes=episodes,
            fresh=ridden,
            results=results,
            on_progress=lambda _: progress.advance(task),
        )
    boards = [board for board in results.summarise() if board.has_episodes_of(runs[0])]
    contents = results.read()
    for board in boards:
        terminal().print(table(board), "")
    for gaps in gap_tables([gap for gap in find_gaps(contents.runs) if gap.scenario == scenario]):
        terminal().print(gaps, "")
    for left in contents.left_out:
        say(f"left out {left.file}: {left.reason}")
    with terminal(errors=True).status("drawing"):
        pictures = pictures_of("scenario", boards, contents.runs, out)
    for path in [results.summary, *pictures]:
        say(f"wrote {path}")


def fresh_number(text: str | None) -> int | str | None:
    """Return the seed of fresh episodes, ``derived`` as it is, and None for the stored ones."""
    if text is None or text == "derived":
        return text
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise ParameterError(f"fresh must be a whole number within [0, 2⁶⁴) or the word derived, got {text!r}")
    return int(text)


COLUMNS: "Mapping[str, Callable[[Score], str]]" = MappingProxyType(
    {
        "path\nerror\n\\[mm]": lambda s: f"{1000 * s.path_error_m:.1f}",
        "mean\nerror\n\\[mm]": lambda s: f"{1000 * s.mean_error_m:.1f}",
        "mean\nspeed\n\\[m/s]": lambda s: f"{s.mean_speed_m_s:.3f}",
        "mean\nacc.\n\\[m/s²]": lambda s: f"{s.mean_acceleration_m_s2:.2f}",
        "peak\nacc.\n\\[m/s²]": lambda s: f"{s.peak_acceleration_m_s2:.2f}",
        "way\n\n\\[m]": lambda s: f"{s.path_length_m:.3f}",
        "at\nthe\nend": lambda s: "yes" if s.completed else "no",
        "time\n\n\\[s]": lambda s: f"{s.duration_s:.2f}",
        "brake\nwork\n\\[J]": lambda s: f"{s.dissipated_j:.2f}",
    }
)
"""The scores of the standard test that are printed, by the titles of their columns."""


def scores_table(result: "Result") -> Table:
    """Return a table with one row per policy and time constant, in SI; it fits a terminal of 80 columns."""
    from pter_gym.benchmark.leaderboard import plain_table

    table = plain_table(
        f"The paper's standard test, seed {result.seed}",
        ["policy", "τ\n\n\\[s]", *COLUMNS],
        caption="path error: at equal pace, mean over ten segments; docs/scoring.md says how",
    )
    for name, runs in result.runs.items():
        for k, run in enumerate(runs):
            texts = [text(run.score) for text in COLUMNS.values()]
            table.add_row(escape(name) if k == 0 else "", f"{run.time_constant:g}", *texts)
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
