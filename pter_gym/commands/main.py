"""``pter``: the commands. Other packages add theirs by the entry-point group ``pter.commands``."""

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from pter_gym._version import __version__
from pter_gym.errors import ParameterError, PterError
from pter_gym.internal.terminal import make_folder, progress_bar
from pter_gym.paper.reproduce.command import reproduce

if TYPE_CHECKING:
    from pter_gym.benchmark import Leaderboard, Result, ResultsFolder

GROUP = "pter.commands"

DESCRIPTION = "PTER, a passive haptic arm with four friction clutches. `pter COMMAND --help` explains a command."

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


POLICIES = "impedance,torque-feedback,free,locked,random"
TIME_CONSTANTS = "0.01,0.03,0.06,0.105,0.15,0.2"
MACHINE = "baseline"
PACES = "slow,medium,brisk"
DEMONSTRATORS = "predictive,single-dof-tuned,torque-feedback-tuned"


def benchmark(
    policies: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = POLICIES,
    scenario: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    paces: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = PACES,
    episodes: Annotated[int | None, tyro.conf.arg(metavar="COUNT")] = None,
    machine: str = MACHINE,
    time_constants: Annotated[str, tyro.conf.arg(metavar="SECONDS,…")] = TIME_CONSTANTS,
    seed: int = 0,
    out: Path = Path("pter-benchmark"),
) -> None:
    """Run the paper's standard test on controllers and compare them, or rank them on a scenario.

    The standard test prints a table and writes benchmark.json, tip_paths.png (as in the paper's Fig. 11) and
    error_against_time.png. A scenario prints a leaderboard for each pace and writes benchmark.json, a file for each run
    and pictures. Runs that stand in the folder already are not repeated; several benchmarks may share a folder.

    Args:
        policies: Separated by commas: impedance, torque-feedback, single-dof, velocity-ratio, free, locked, random;
            on a scenario also impedance-tuned and so on, predictive and predictive-honest; trained ones: see
            docs/agents.md.
        scenario: Scenario whose stored evaluation episodes are run; the paper's standard test by default.
        paces: Commanded paces of a scenario, separated by commas: slow, medium, brisk.
        episodes: How many of the scenario's episodes to run; all by default. Ranks need 200.
        machine: Clutch material of the standard test: baseline, delrin_experimental or delrin_theoretical.
        time_constants: Time constants of the standard test's clutches [s], separated by commas; one episode each.
        seed: Seed of the standard test's episodes, and of random and predictive policies, at least 0.
        out: Folder for the results; made if need be.
    """
    if scenario is None:
        given = {"paces": paces != PACES, "episodes": episodes is not None}
        refuse(given, "--scenario")
        standard_test(split(policies), machine, numbers("time_constants", time_constants), seed, out)
    else:
        given = {"machine": machine != MACHINE, "time_constants": time_constants != TIME_CONSTANTS}
        refuse(given, "no --scenario: it has machines of its own")
        scenario_benchmark(scenario, split(policies), split(paces), episodes, seed, out)


def refuse(given: Mapping[str, bool], needed: str) -> None:
    """Raise a ParameterError that names an argument that was given where it has no meaning."""
    for name, is_given in given.items():
        if is_given:
            raise ParameterError(f"{name} needs {needed}")


def standard_test(names: list[str], machine: str, seconds: list[float], seed: int, out: Path) -> None:
    """Run the paper's standard test on controllers, print its table and write its results to a folder."""
    from pter_gym.benchmark import find_controller, run_standard_test
    from pter_gym.envs.single import find_machine

    console = Console()
    chosen = {name: find_controller(name, seed) for name in names}
    chosen_machine = find_machine(machine)
    make_folder(out)
    with progress_bar(console) as progress:
        task = progress.add_task("standard test", total=len(chosen))
        result = run_standard_test(
            chosen,
            machine=chosen_machine,
            time_constants=seconds,
            seed=seed,
            on_progress=lambda _: progress.advance(task),
        )
    console.print(scores_table(result))
    for path in write_result(result, out):
        console.print(f"wrote {path}", highlight=False)


def scenario_benchmark(
    scenario: str, names: list[str], paces: list[str], episodes: int | None, seed: int, out: Path
) -> None:
    """Run controllers on a scenario's evaluation episodes, print its leaderboards and write its results to a folder."""
    from pter_gym.benchmark import ResultsFolder, find_policy, run_scenario
    from pter_gym.benchmark.leaderboard import table

    console = Console()
    results = ResultsFolder(out)
    with progress_bar(console) as progress:
        task = progress.add_task(scenario, total=len(names) * len(paces))
        runs = run_scenario(
            scenario,
            {name: find_policy(name, seed, scenario) for name in names},
            paces,
            episodes=episodes,
            results=results,
            on_progress=lambda _: progress.advance(task),
        )
    boards = [board for board in results.summarise() if board.has_episodes_of(runs[0])]
    for board in boards:
        console.print(table(board), "")
    for path in [results.summary, *draw_boards(boards, results)]:
        console.print(f"wrote {path}", highlight=False)


def fit(seed: int = 0, budget: int = 60_000, held_out: bool = False, out: Path = Path("pter-preset.toml")) -> None:
    """Search for values that the paper does not print, by its Table I and its trends, and write them as a preset.

    Args:
        seed: Seed of the search, at least 0; the same seed and budget give the same result.
        budget: Evaluated candidates, at least 300.
        held_out: Fit Table I alone and keep the trends held out.
        out: File for the preset; its folder must exist.
    """
    from pter_gym.paper.experiments.calibration import FitArguments
    from pter_gym.paper.experiments.calibration import fit as search

    result = search(FitArguments(seed=seed, budget=budget, held_out=held_out, out=out))
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"misfit {result.misfit:.4f}; Table I in the paper's units: {result.table.round(3).tolist()}")
    console.print(f"wrote {out}")


def speed(quick: bool = False, max_worlds: int = 4_000_000, out: Path = Path("pter-speed")) -> None:
    """Measure the simulator's speed beside its peers, in one run of a few minutes.

    Prints tables, and writes speed.json and speed.png. Peers that are not installed (MuJoCo, EnvPool) and a GPU that is
    not there are skipped and named. The machine should have nothing else to do.

    Args:
        quick: Half a minute, small batches: whether it works, not how fast it is.
        max_worlds: Largest number of worlds; a CPU gets at most 1,000,000.
        out: Folder for the results; made if need be.
    """
    from pter_gym.internal.files import write_text_atomic
    from pter_gym.plots import save
    from pter_gym.speed import make_plan, measure, notes, tables
    from pter_gym.speed.plot import cost_figure

    plan = make_plan(quick=quick, max_worlds=max_worlds)
    make_folder(out)
    console = Console()
    with console.status("speed") as status:
        found = measure(plan, lambda what: status.update(f"measuring {what}"))
    for table in tables(found):
        console.print(table)
        console.print()
    for note in notes(found):
        console.print(note, highlight=False)
    write_text_atomic(out / "speed.json", json.dumps(found.as_json(), indent=2) + "\n")
    save(cost_figure(found), out / "speed.png")
    for name in ("speed.json", "speed.png"):
        console.print(f"wrote {out / name}", highlight=False)


def tune(
    controller: Annotated[str, tyro.conf.Positional],
    scenario: Annotated[str, tyro.conf.arg(metavar="NAME")] = "standard",
    pace: Annotated[str, tyro.conf.arg(metavar="NAME")] = "medium",
    trials: int = 2000,
    episodes: int = 200,
    storage: Path = Path("pter-tune.db"),
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Search for a controller's gains on training draws of a scenario, at a commanded pace.

    The trials are kept in an SQLite file: a search that was stopped goes on where it was, and several may share the
    work. The best gains are those with the smallest path error of all that arrive and keep the pace. Needs Optuna:
    install pter-gym[tune].

    Args:
        controller: impedance, torque-feedback, single-dof or velocity-ratio.
        scenario: Scenario whose training draws are used; its evaluation episodes are never read.
        pace: Commanded pace: slow, medium or brisk.
        trials: Gains to try, at least 1.
        episodes: Training draws for each trial, at least 1.
        storage: SQLite file of the trials; its folder must exist.
        seed: Seed of the draws and the search, at least 0.
        out: File for the best gains, whose other entries stay; they are only printed by default.
    """
    from pter_gym.tuning import add_study
    from pter_gym.tuning import tune as search

    if out is not None and not out.parent.is_dir():
        raise ParameterError(f"out must be a file in a folder that exists, got {str(out)!r}")
    console = Console(highlight=False, soft_wrap=True)
    with progress_bar(console) as progress:
        task = progress.add_task(f"{controller}, {scenario}, {pace}", total=trials)

        def show(finished: int, best: float) -> None:
            progress.update(
                task, completed=finished, description=f"{controller}, {scenario}, {pace}: {1000 * best:.1f} mm"
            )

        study = search(
            controller, scenario, pace, trials=trials, episodes=episodes, storage=storage, seed=seed, on_trial=show
        )
    found = study.verdict
    for name, gain in study.gains.items():
        console.print(f"{name} = {gain!r}")
    console.print(
        f"path error {1000 * found.path_error_m:.1f} mm, at the end {100 * found.completed:.3g} %, mean pace "
        f"±{100 * found.mean_pace_error:.3g} %, segment pace ±{100 * found.segment_pace_error:.3g} % on other draws"
    )
    if out is not None:
        add_study(study, out)
        console.print(f"wrote {out}")


def record(
    policies: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = DEMONSTRATORS,
    scenarios: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = "standard,everything",
    paces: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = PACES,
    episodes: int = 4,
    seed: int = 0,
    out: Path = Path("pter-demonstrations.npz"),
) -> None:
    """Simulate policies on training draws of scenarios and write what they saw and did to one file, for imitation.

    The file is a NumPy archive without pickles, for `pter_gym.benchmark.demonstrations.read_demonstrations`. The
    stored evaluation episodes are never read.

    Args:
        policies: Separated by commas, as for `pter benchmark --scenario`.
        scenarios: Scenarios whose training draws are used, separated by commas.
        paces: Commanded paces, separated by commas: slow, medium, brisk.
        episodes: Training draws for each scenario and pace, at least 1; all policies have the same.
        seed: Seed of the draws, at least 0.
        out: File to write; its folder must exist.
    """
    from pter_gym.benchmark.demonstrations import record as simulate
    from pter_gym.benchmark.demonstrations import write_demonstrations

    if not out.parent.is_dir():
        raise ParameterError(f"out must be a file in a folder that exists, got {str(out)!r}")
    console = Console(highlight=False, soft_wrap=True)
    names = split(policies), split(scenarios), split(paces)
    with progress_bar(console) as progress:
        task = progress.add_task("record", total=math.prod(len(each) for each in names) * max(episodes, 0))
        found = simulate(*names, episodes=episodes, seed=seed, on_episode=lambda: progress.advance(task))
    write_demonstrations(found, out)
    console.print(f"{len(found)} episodes, {len(found.obs)} decisions, {out.stat().st_size / 1e6:.1f} MB")
    console.print(f"wrote {out}")


def scores_table(result: "Result") -> Table:
    """Return a table with one row per policy and time constant, in SI; it fits a terminal of 80 columns."""
    table = Table(
        title=f"The paper's standard test, seed {result.seed}",
        caption="path error: the larger average, over time or path; unfinished parts at the worst error or the bound",
        box=None,
        padding=(0, 1),
        collapse_padding=True,
        pad_edge=False,
    )
    table.add_column("policy", no_wrap=True)
    for header in (
        "τ\n\n\\[s]",
        "path\nerror\n\\[mm]",
        "mean\nerror\n\\[mm]",
        "mean\nspeed\n\\[m/s]",
        "mean\nacc.\n\\[m/s²]",
        "peak\nacc.\n\\[m/s²]",
        "way\n\n\\[m]",
        "at\nthe\nend",
        "time\n\n\\[s]",
        "brake\nwork\n\\[J]",
    ):
        table.add_column(header, justify="right", no_wrap=True)
    for name, runs in result.runs.items():
        for k, run in enumerate(runs):
            s = run.score
            table.add_row(
                name if k == 0 else "",
                f"{run.time_constant:g}",
                f"{1000 * s.path_error_m:.1f}",
                f"{1000 * s.mean_error_m:.1f}",
                f"{s.mean_speed_m_s:.3f}",
                f"{s.mean_acceleration_m_s2:.2f}",
                f"{s.peak_acceleration_m_s2:.2f}",
                f"{s.path_length_m:.3f}",
                "yes" if s.completed else "no",
                f"{s.duration_s:.2f}",
                f"{s.dissipated_j:.2f}",
            )
        table.add_row()
    return table


def write_result(result: "Result", out: Path) -> list[Path]:
    """Write ``benchmark.json`` and the pictures to a folder that exists; return their paths."""
    from pter_gym.internal.files import write_text_atomic
    from pter_gym.plots import save
    from pter_gym.plots.benchmark import error_against_time, tip_paths

    paths = [out / "benchmark.json", out / "tip_paths.png", out / "error_against_time.png"]
    write_text_atomic(paths[0], json.dumps(result.as_json(), indent=2) + "\n")
    save(tip_paths(result), paths[1])
    save(error_against_time(result), paths[2])
    return paths


def draw_boards(boards: "Sequence[Leaderboard]", results: "ResultsFolder") -> list[Path]:
    """Draw the leaderboards of one scenario into the folder of their results; return the pictures' paths."""
    from pter_gym.benchmark.episodes import load_episodes
    from pter_gym.plots import leaderboard as plots
    from pter_gym.plots import save

    runs = results.runs()
    scenario = boards[0].scenario
    figures = {
        "profiles": plots.profiles(boards, runs),
        "error-against-pace": plots.error_against_pace(boards),
        "error-against-smoothness": plots.error_against_smoothness(boards),
    }
    for board in boards:
        figures[f"trajectories-{board.pace}"] = plots.trajectories(board, runs, load_episodes(scenario, board.pace))
    for name, figure in figures.items():
        save(figure, results.path / f"{scenario}-{name}.png")
    return [results.path / f"{scenario}-{name}.png" for name in figures]


def split(text: str) -> list[str]:
    """Return the parts of a list that is separated by commas, without repeats."""
    return list(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def numbers(field: str, text: str) -> list[float]:
    """Return the numbers of a list that is separated by commas, or raise a ParameterError that names the field."""
    try:
        found = [float(part) for part in split(text)]
    except ValueError:
        found = []
    if not found:
        raise ParameterError(f"{field} must be numbers separated by commas, got {text!r}")
    return found


def commands() -> dict[str, Callable[..., Any]]:
    """Return all commands by name: the built-in ones and those of installed packages."""
    found: dict[str, Callable[..., Any]] = {
        "benchmark": benchmark,
        "fit": fit,
        "record": record,
        "reproduce": reproduce,
        "speed": speed,
        "tune": tune,
    }
    for entry in entry_points(group=GROUP):
        found[entry.name] = entry.load()
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run ``pter`` and return its exit status: 0, 2 for a wrong argument, 130 after Ctrl-C."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        Console().print(f"pter {__version__}", highlight=False)
        return 0
    try:
        tyro.extras.subcommand_cli_from_dict(
            commands(),
            prog="pter",
            description=DESCRIPTION,
            args=arguments,
        )
    except PterError as error:
        Console(stderr=True).print(f"error: {error}", style="red", highlight=False, soft_wrap=True, markup=False)
        return 2
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted; results that were written are whole", highlight=False)
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    sys.exit(main())
