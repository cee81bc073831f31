"""Blocks made from the scores in a results folder of `pter benchmark`."""

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

from markup import code, joined, table

from pter_gym.benchmark import Leaderboard, ResultsFolder, leaderboards
from pter_gym.benchmark.boards import Standing, in_order
from pter_gym.benchmark.cells import UNRANKED, millimetres, with_interval
from pter_gym.benchmark.faults import cell, fault_table
from pter_gym.policies.find import DETECTOR
from pter_gym.scenarios import PACES, SCENARIOS

LEFT_OUT = ("free", "locked", "random")
"""Policies that any other beats, shown on the scenarios' own pages only."""

README = (
    "residual",
    "ppo-standard",
    "single-dof-tuned",
    "torque-feedback-tuned",
    "torque-feedback",
    "impedance",
)
"""Policies whose scores README shows."""

SEARCHED = ("residual", "universal", "single-dof-tuned")
"""Policies whose worst hands are searched; on `standard` README's, too."""

FAILING = (*SEARCHED, "ppo-standard", "torque-feedback-tuned")
"""Policies that are scored where a clutch fails."""

CLUTCHES = range(1, 5)
"""Those that are dead, or called so, in the runs of `benchmarks/failures.py score`."""

ERRORS = {"Worst 1/20": "worst_path_error_m", "RMS": "rms_error_m"}
"""Errors that a leaderboard shows beside the path error, by their titles."""

BOARDS: dict[str, Callable[..., str]] = {}


def board(function: Callable[..., str]) -> Callable[..., str]:
    """Offer a function to pages."""
    return BOARDS.setdefault(function.__name__, function)


@cache
def all_boards(results: Path) -> tuple[Leaderboard, ...]:
    """Return the leaderboards of the runs in a folder."""
    return leaderboards(ResultsFolder(results).runs())


def boards_of(results: Path, scenario: str) -> dict[str, Leaderboard]:
    """Return the leaderboards of a scenario by pace, those of the most episodes."""
    ordered = sorted(all_boards(results), key=lambda each: each.episodes)
    by_pace = {each.pace: each for each in ordered if each.scenario == scenario}
    if missing := [pace for pace in PACES if pace not in by_pace]:
        raise ValueError(f"{results} has no {scenario} at {', '.join(missing)}")
    return {pace: by_pace[pace] for pace in PACES}


def marked(text: str, standing: Standing) -> str:
    """Return a score as text with the mark of a policy that is not ranked."""
    return text if standing.rank else f"{text} {UNRANKED}"


@board
def readme(results: Path, scenario: str) -> str:
    """Return the policies of README over paces."""
    return by_pace(results, scenario, README)


@board
def by_pace(results: Path, scenario: str, names: Collection[str] = ()) -> str:
    """Return path errors of policies over paces, in the order of `pter benchmark`."""
    at_paces = boards_of(results, scenario)
    shown = {
        name: row
        for name, row in in_order(list(at_paces.values())).items()
        if (name in names if names else name not in LEFT_OUT)
    }
    rows = [
        [
            code(name),
            *(joined(marked(with_interval(each.error), each)) if each else "" for each in row),
        ]
        for name, row in shown.items()
    ]
    header = ["Policy", *(f"{pace} ({speed:g} m/s)" for pace, speed in PACES.items())]
    if any(each and each.worst for row in shown.values() for each in row):
        header.append("Worst hand")
        for cells, row in zip(rows, shown.values(), strict=True):
            worst = [millimetres(each.worst.path_error_m) for each in row if each and each.worst]
            cells.append(joined(" / ".join(worst)))
    title = at_paces["slow"].title.removeprefix(scenario)
    return f"`{scenario}`{title}:\n\n{table(header, rows, '---:')}"


@board
def failures(results: Path, scenario: str) -> str:
    """Return a table for each pace: rows of what fails, columns of policies."""
    parts = [f"{boards_of(results, scenario)['slow'].title}:\n"]
    for pace, speed in PACES.items():
        healthy = boards_of(results, scenario)[pace]
        impaired = [
            replace(each, standings=tuple(one for one in each.standings if one.policy in FAILING))
            for each in variants(results, healthy)
            if each.failures
        ]
        if not impaired:
            raise ValueError(f"{results} has no runs with --faults of {healthy.title}")
        head, *rows = fault_table([healthy, *impaired])
        cells = [[row[0], *map(joined, row[1:])] for row in rows]
        names = ["", *map(code, head[1:])]
        parts.append(f"### {pace.capitalize()}: {speed:g} m/s\n\n{table(names, cells, '---:')}")
    return "\n".join(parts)


def variants(results: Path, healthy: Leaderboard) -> list[Leaderboard]:
    """Return the boards of the same episodes with what fails, or is said to."""
    same = (healthy.pace, healthy.episodes, healthy.seed)
    return [
        each
        for each in all_boards(results)
        if each.scenario.startswith(f"{healthy.scenario}, ")
        and (each.pace, each.episodes, each.seed) == same
    ]


@board
def remains(results: Path, scenario: str) -> str:
    """Return what policies make of a dead clutch: not told, with a detector, told; the best law."""
    title = boards_of(results, scenario)["slow"].title
    head = ["Dead", "Pace", "Best law there"]
    head += [f"{code(name)}: not told / detector / told" for name in SEARCHED]
    return f"{title}:\n\n{table([*head, 'Told over best'], _rows_left(results, scenario))}"


def _rows_left(results: Path, scenario: str) -> list[list[str]]:
    rows: list[list[str]] = []
    for clutch, (pace, healthy) in product(CLUTCHES, boards_of(results, scenario).items()):
        title = f"{scenario}, clutch {clutch} dead"
        (found,) = (each for each in variants(results, healthy) if each.scenario == title)
        # laws differ from pace to pace, which their name then says in brackets
        standings = {each.policy.partition(" (")[0]: each for each in found.standings}
        best, told = standings["best law"], standings[f"{SEARCHED[1]}, told"]
        triples = (
            " / ".join(
                cell(standings.get(each)) for each in (name, f"{name}{DETECTOR}", f"{name}, told")
            )
            for name in SEARCHED
        )
        ratio = f"{told.error.value / best.error.value:.2f}"
        rows.append([str(clutch), pace, *map(joined, (cell(best), *triples)), ratio])
    return rows


@board
def false_alarms(results: Path, scenario: str) -> str:
    """Return what it costs that a healthy clutch is called dead from the start."""
    rows: list[list[str]] = []
    for pace, healthy in boards_of(results, scenario).items():
        usual = {each.policy: each for each in healthy.standings}
        boards = {each.scenario: each for each in variants(results, healthy)}
        for name in SEARCHED:
            cells = [cell(usual[name])]
            for clutch in CLUTCHES:
                called = boards[f"{scenario}, clutch {clutch} called dead"].standings
                cells += [cell(each) for each in called if each.policy == name]
            rows.append([code(name), pace, *map(joined, cells)])
    return table(["Policy", "Pace", "none", *map(str, CLUTCHES)], rows)


@board
def scores(results: Path, scenario: str) -> str:
    """Return all leaderboards of a scenario, and why some policies have no rank."""
    header = ["Policy", "Rank", "Path error [mm]", *(f"{title} [mm]" for title in ERRORS)]
    header += ["Completed [%]", "Off pace [%]", "Segments [%]"]
    header += ["Peak acc. [m/s²]"]
    parts: list[str] = []
    at_paces = boards_of(results, scenario)
    searched = any(each.worst for board in at_paces.values() for each in board.standings)
    header += ["Worst hand [mm]"] * searched
    for pace, found in at_paces.items():
        rows = [
            [
                code(each.policy),
                str(each.rank or UNRANKED),
                with_interval(each.error),
                *(millimetres(each.scores[name]) for name in ERRORS.values()),
                f"{100 * each.scores['completed']:.4g}",
                *(f"{100 * each.scores[f'{of}_pace_error']:.1f}" for of in ("mean", "segment")),
                f"{each.scores['peak_acceleration_m_s2']:.1f}",
                *([millimetres(each.worst.path_error_m) if each.worst else ""] * searched),
            ]
            for each in found.standings
        ]
        episodes = found.title.partition(", ")[2]
        text = f"## {pace.capitalize()}: {PACES[pace]:g} m/s\n\n{episodes}:\n\n"
        below = [f"- `{each.policy}` {each.reason}.\n" for each in found.standings if each.reason]
        text += table(header, rows, "---:")
        parts.append(f"{text}\n{UNRANKED} Not ranked:\n\n{''.join(below)}" if below else text)
    return "\n".join(parts)


@board
def best(results: Path) -> str:
    """Return which ranked policy has the smallest path error, and which the smallest others."""
    rows: list[list[str]] = []
    for scenario in SCENARIOS:
        for pace, found in boards_of(results, scenario).items():
            ranked = [each for each in found.standings if each.rank]
            cells: list[str] = []
            for error in ("path_error_m", *ERRORS.values()):
                first = min(ranked, key=lambda each: each.scores[error], default=None)
                text = first and f"`{first.policy}` {millimetres(first.scores[error])}"
                cells.append(joined(text) if text else "–")
            rows.append([code(scenario), pace, *cells])
    return table(["Scenario", "Pace", "Path error", *ERRORS], rows)


@board
def suite(results: Path) -> str:
    """Return a table for each pace: rows of policies, columns of scenarios, the best bold."""
    at_paces = {scenario: boards_of(results, scenario) for scenario in SCENARIOS}
    names = [name for name in in_order(list(at_paces["standard"].values())) if name not in LEFT_OUT]
    parts: list[str] = []
    for pace, speed in PACES.items():
        columns = [
            {each.policy: error_of(each) for each in at_paces[scenario][pace].standings}
            for scenario in SCENARIOS
        ]
        rows = [[code(name), *(column.get(name, "") for column in columns)] for name in names]
        head = ["Policy", *map(code, SCENARIOS)]
        parts.append(f"### {pace.capitalize()}: {speed:g} m/s\n\n{table(head, rows, '---:')}")
    return "\n".join(parts)


@board
def worst_hands(results: Path) -> str:
    """Return mean and largest errors of the policies in `SEARCHED` at the three paces."""
    rows: list[list[str]] = []
    for scenario in SCENARIOS:
        boards = boards_of(results, scenario).values()
        by_name = [{each.policy: each for each in board.standings} for board in boards]
        means, worst = list[str](), list[str]()
        for name in SEARCHED:
            found = [policies[name] for policies in by_name]
            means.append(joined(" / ".join(millimetres(each.error.value) for each in found)))
            errors = (each.worst.path_error_m for each in found if each.worst)
            worst.append(joined(" / ".join(map(millimetres, errors))))
        rows += [[code(scenario), "mean", *means], ["", "worst", *worst]]
    return table(["Scenario", "", *map(code, SEARCHED)], rows)


def error_of(standing: Standing) -> str:
    """Return a path error, bold if it is the best with a rank."""
    text = millimetres(standing.error.value)
    return joined(marked(f"**{text}**" if standing.rank == 1 else text, standing))
