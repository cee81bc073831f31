"""Blocks made from the scores in a results folder of `pter benchmark`."""

import json
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from markup import code, joined, table

from pter_gym.benchmark.boards import UNRANKED, pace_error, with_interval
from pter_gym.benchmark.intervals import Interval
from pter_gym.scenarios import PACES, SCENARIOS

Board = dict[str, Any]

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

ERRORS = {
    "Worst twentieth": "worst_path_error_m",
    "Without the first tenth": "later_path_error_m",
    "Time average": "mean_error_m",
    "RMS over length": "rms_error_m",
}
"""Errors that a leaderboard shows beside the path error, by their titles."""

BOARDS: dict[str, Callable[..., str]] = {}


def board(function: Callable[..., str]) -> Callable[..., str]:
    """Offer a function to pages."""
    return BOARDS.setdefault(function.__name__, function)


@cache
def summary(results: Path) -> dict[str, Any]:
    """Return what `benchmark.json` says."""
    return json.loads((results / "benchmark.json").read_text("utf-8"))


def boards_of(results: Path, scenario: str) -> dict[str, Board]:
    """Return the leaderboards of a scenario by pace; those of the most episodes where there are several."""
    found = {
        each["pace"]: each
        for each in sorted(summary(results)["leaderboards"], key=lambda each: each["episodes"])
        if each["scenario"] == scenario
    }
    if missing := [pace for pace in PACES if pace not in found]:
        raise ValueError(f"{results} has no {scenario} at {', '.join(missing)}")
    return {pace: found[pace] for pace in PACES}


def episodes_text(found: Board) -> str:
    """Return which episodes a leaderboard has."""
    seed = found.get("seed")
    return f"{found['episodes']:,} {'stored episodes' if seed is None else f'fresh episodes, seed {seed}'}"


def intervals(scores: Board) -> dict[str, Interval]:
    """Return the scores of a policy by their names."""
    return {name: Interval(**each) for name, each in scores.items() if isinstance(each, dict)}


def path_error(scores: Board) -> str:
    """Return the path error [mm] with its interval, if it has one, and the mark of a policy that is not ranked."""
    mark = "" if scores["rank"] else f" {UNRANKED}"
    return joined(with_interval(intervals(scores)["path_error_m"], factor=1000.0) + mark)


def millimetres(scores: Board, name: str) -> str:
    """Return an error in mm."""
    return f"{1000 * scores[name]['value']:.1f}"


@board
def readme(results: Path, scenario: str) -> str:
    """Return the policies of README over paces."""
    return by_pace(results, scenario, README)


@board
def by_pace(results: Path, scenario: str, names: Sequence[str] | None = None) -> str:
    """Return path errors of policies over paces, the best at the first pace first."""
    found = boards_of(results, scenario)
    policies = [each["policies"] for each in found.values()]
    shown = [
        name for name in policies[0] if (name not in LEFT_OUT if names is None else name in names)
    ]
    shown.sort(key=lambda name: policies[0][name]["path_error_m"]["value"])
    rows = [[code(name), *(path_error(each[name]) for each in policies)] for name in shown]
    header = ["Policy", *(f"{pace} ({speed:g} m/s)" for pace, speed in PACES.items())]
    return f"`{scenario}`, {episodes_text(found['slow'])}:\n\n{table(header, rows)}"


@board
def scores(results: Path, scenario: str) -> str:
    """Return all leaderboards of a scenario, and why some policies have no rank."""
    header = ["Policy", "Rank", "Path error [mm]", *(f"{title} [mm]" for title in ERRORS)]
    header += [
        "Completed [%]",
        "Mean pace error [%]",
        "Segment pace error [%]",
        "RMS acceleration [m/s²]",
    ]
    parts: list[str] = []
    for pace, found in boards_of(results, scenario).items():
        rows = [
            [
                code(policy),
                str(scores["rank"] or UNRANKED) + ("?" if scores["undecided"] else ""),
                with_interval(intervals(scores)["path_error_m"], factor=1000.0),
                *(millimetres(scores, name) for name in ERRORS.values()),
                f"{100 * scores['completed']['value']:.3g}",
                *(
                    pace_error(intervals(scores), f"{of}_pace_error", found["pace_m_s"])
                    for of in ("mean", "segment")
                ),
                f"{scores['rms_acceleration_m_s2']['value']:.2f}",
            ]
            for policy, scores in found["policies"].items()
        ]
        text = f"## {pace.capitalize()}: {found['pace_m_s']:g} m/s\n\n{episodes_text(found)}:\n\n"
        below = [
            f"- `{name}` {scores['reason']}.\n"
            for name, scores in found["policies"].items()
            if scores["reason"]
        ]
        text += table(header, rows, "---:")
        parts.append(f"{text}\n{UNRANKED} Not ranked:\n\n{''.join(below)}" if below else text)
    return "\n".join(parts)


@board
def best(results: Path) -> str:
    """Return which ranked policy has the smallest path error, and which the smallest of each of the other errors."""
    rows: list[list[str]] = []
    for scenario in SCENARIOS:
        for pace, found in boards_of(results, scenario).items():
            ranked = {name: scores for name, scores in found["policies"].items() if scores["rank"]}
            cells: list[str] = []
            for error in ("path_error_m", *ERRORS.values()):
                first = min(ranked, key=lambda name: ranked[name][error]["value"], default=None)
                cells.append(
                    joined(f"`{first}` {millimetres(ranked[first], error)}") if first else "–"
                )
            rows.append([code(scenario), pace, *cells])
    return table(["Scenario", "Pace", "Path error", *ERRORS], rows)


@board
def suite(results: Path) -> str:
    """Return a table of a row for each policy and a column for each scenario."""
    found = {scenario: boards_of(results, scenario) for scenario in SCENARIOS}
    first = found["standard"]["slow"]["policies"]
    names = sorted(
        (name for name in first if name not in LEFT_OUT),
        key=lambda name: first[name]["path_error_m"]["value"],
    )

    def errors(of_scenario: dict[str, Board], name: str) -> str:
        scores = [
            each["policies"][name] for each in of_scenario.values() if name in each["policies"]
        ]
        shown = ((millimetres(each, "path_error_m"), each["rank"]) for each in scores)
        return ", ".join(error if ranked else f"{error} {UNRANKED}" for error, ranked in shown)

    rows = [[code(name), *(errors(each, name) for each in found.values())] for name in names]
    return table(["Policy", *map(code, found)], rows)
