"""Tables of the scores in a results folder of `pter benchmark`."""

import json
import re
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

from pages import BELOW, joined, signed, table

from pter_gym.benchmark import ResultsFolder
from pter_gym.benchmark._runs import ScenarioRun
from pter_gym.benchmark.leaderboard import rank, seed_text
from pter_gym.benchmark.ranking import PRIVILEGED
from pter_gym.benchmark.statistics import unpaired_interval
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import PACES, SCENARIOS

Board = dict[str, Any]
LEFT_OUT = ("free", "locked", "random")
PLANNER = "predictive"
LEARNED = "residual"
MEANS = ("completed", "mean_pace_error", "segment_pace_error")
ERRORS = {
    "Worst twentieth": "worst_path_error_m",
    "Without the first tenth": "later_path_error_m",
    "Time average": "mean_error_m",
    "RMS over length": "rms_error_m",
}
"""Errors that a leaderboard shows beside the path error, by their titles."""
SEEDED = re.compile(r"(?P<name>.+)-(?P<seed>\d+)")


@cache
def summary(results: Path) -> dict[str, Any]:
    """Return what `benchmark.json` says."""
    return json.loads((results / "benchmark.json").read_text("utf-8"))


def boards(results: Path, scenario: str) -> dict[str, Board]:
    """Return the leaderboards of a scenario by pace: those of the most episodes, fresh ones if there are any."""
    own = [board for board in summary(results)["leaderboards"] if board["scenario"] == scenario]
    fresh = any(board["fresh"] is not None for board in own)
    own = sorted((board for board in own if (board["fresh"] is not None) == fresh), key=lambda each: each["episodes"])
    found = {board["pace"]: board for board in own}
    if missing := [pace for pace in PACES if pace not in found]:
        raise ValueError(f"{results} has no {scenario} at {', '.join(missing)}")
    return {pace: found[pace] for pace in PACES}


def episodes_text(board: Board) -> str:
    """Say which episodes a leaderboard has."""
    kind = "stored episodes" if board["fresh"] is None else f"fresh episodes, {seed_text(board['fresh'])}"
    return f"{board['episodes']:,} {kind}"


def interval(scores: Board) -> str:
    """Path error in mm with its interval."""
    low, value, high = (1000 * scores["path_error_m"][key] for key in ("low", "value", "high"))
    return f"{value:.1f} ({low:.1f} … {high:.1f})"


def millimetres(scores: Board, name: str) -> str:
    """An error in mm."""
    return f"{1000 * scores[name]['value']:.1f}"


def percent(scores: Board, style: str) -> list[str]:
    """Arrivals, and errors of the mean and the segments' pace, in percent."""
    return [f"{100 * scores[name]['value']:{part}}" for name, part in zip(MEANS, style.split(), strict=True)]


def cell(scores: Board, *, details: bool) -> str:
    """Path error with its interval; with details, arrivals and pace errors; marked below the line."""
    text = joined(interval(scores) + ("" if scores["reason"] in (None, PRIVILEGED) else f" {BELOW}"))
    if not details:
        return text
    arrives, mean, segments = percent(scores, ".3g .0f .0f")
    return f"{text}; {arrives} %, ±{mean} %, ±{segments} %"


def by_pace(results: Path, scenario: str, names: Iterable[str] | None = None, *, details: bool = False) -> str:
    """Policies over paces, the best at the first pace first: some, or all but those that anybody is better than."""
    found = boards(results, scenario)
    policies = [board["policies"] for board in found.values()]
    names = [name for name in policies[0] if name not in LEFT_OUT] if names is None else names
    shown = [name for name in names if all(name in each for each in policies)]
    shown.sort(key=lambda name: policies[0][name]["path_error_m"]["value"])
    rows = [
        [
            f"`{name}`{' (privileged)' if policies[0][name]['privileged'] else ''}",
            *(cell(each[name], details=details) for each in policies),
        ]
        for name in shown
    ]
    (episodes,) = {episodes_text(board) for board in found.values()}
    header = ["Policy", *(f"{pace} ({speed:g} m/s)" for pace, speed in PACES.items())]
    return f"`{scenario}`, {episodes}:\n\n{table(header, rows, '---')}"


def classical(results: Path, scenario: str, *, details: bool = False) -> str:
    """Policies over paces without the trained ones."""
    names = boards(results, scenario)["slow"]["policies"]
    return by_pace(
        results, scenario, (name for name in names if name not in {*LEFT_OUT, *shipped_policies()}), details=details
    )


def by_tuning(results: Path) -> str:
    """By how much tuning changes the path error on `standard`, and by how much another law does."""
    pairs = [("impedance-tuned", "impedance"), ("torque-feedback-tuned", "torque-feedback")]
    pairs += [(name, "impedance-tuned") for name in ("velocity-ratio-tuned", "single-dof-tuned")]
    lines: list[str] = []
    for pair in pairs:
        errors = [
            [board["policies"][name]["path_error_m"]["value"] for name in pair]
            for board in boards(results, "standard").values()
        ]
        changes = signed(", ".join(f"{100 * (mine / its - 1):+z.0f} %" for mine, its in errors))
        lines.append(f"- `{pair[0]}` against `{pair[1]}`: {changes}.\n")
    return f"{classical(results, 'standard')}\nPath error at the three paces:\n\n{''.join(lines)}"


def predictive(results: Path) -> str:
    """What planning reaches, and how long a decision takes."""
    scenarios = sorted({board["scenario"] for board in summary(results)["leaderboards"]})
    parts: list[str] = []
    for scenario in scenarios:
        taken = [board["policies"][PLANNER]["planning"]["decision_ms"] for board in boards(results, scenario).values()]
        shown = by_pace(results, scenario, (PLANNER, LEARNED, "single-dof-tuned"), details=True)
        cost = f"{min(taken):.0f} to {max(taken):.0f} ms of CPU time on one core"
        parts.append(f"{shown}\nA decision of `{PLANNER}` took {cost}.\n")
    return "\n".join(parts)


def leaderboard(results: Path, scenario: str) -> str:
    """All leaderboards of a scenario, and why some policies have no rank."""
    header = ["", "Policy", "Path error [mm]", *(f"{title} [mm]" for title in ERRORS)]
    header += ["Arrives [%]", "Mean pace error [%]", "Segment pace error [%]"]
    parts: list[str] = []
    for pace, board in boards(results, scenario).items():
        rows = [
            [
                "–" if scores["rank"] is None else str(scores["rank"]),
                f"`{policy}`",
                joined(interval(scores)),
                *(millimetres(scores, name) for name in ERRORS.values()),
                *percent(scores, ".3g .3g .3g"),
                f"{scores['rms_acceleration_m_s2']['value']:.2f}",
            ]
            for policy, scores in board["policies"].items()
        ]
        text = f"## {pace.capitalize()}: {board['pace_m_s']:g} m/s\n\n{episodes_text(board)}:\n\n"
        text += table([*header, "RMS acceleration [m/s²]"], rows).replace("|---:|---:|---:|", "|---|---|---:|", 1)
        below = [f"- `{name}` {scores['reason']}.\n" for name, scores in board["policies"].items() if scores["reason"]]
        parts.append(text + ("\nBelow the line:\n\n" + "".join(below) if below else ""))
    return "\n".join(parts)


def first_by(results: Path) -> str:
    """Which policy with a rank has the smallest path error, and which the smallest of each of the other errors."""
    rows: list[list[str]] = []
    for scenario in SCENARIOS:
        for pace, board in boards(results, scenario).items():
            ranked = {name: scores for name, scores in board["policies"].items() if scores["rank"] is not None}
            firsts = [
                (min(ranked, key=lambda policy: ranked[policy][error]["value"]), error)
                for error in ("path_error_m", *ERRORS.values())
                if ranked
            ]
            cells = [joined(f"`{name}` {millimetres(ranked[name], error)}") for name, error in firsts]
            rows.append([f"`{scenario}`", pace, *(cells or ["–"] * (1 + len(ERRORS)))])
    return table(["Scenario", "Pace", "Path error", *ERRORS], rows, "---")


def suite(results: Path) -> str:
    """One line for each policy, one column for each scenario."""
    found = {scenario: boards(results, scenario) for scenario in SCENARIOS}
    first = next(iter(found.values()))["slow"]["policies"]
    names = [name for name in first if name not in (*LEFT_OUT, PLANNER)]
    names.sort(key=lambda name: first[name]["path_error_m"]["value"])

    def errors(of_scenario: dict[str, Board], name: str) -> str:
        scores = [board["policies"][name] for board in of_scenario.values() if name in board["policies"]]
        shown = [(f"{1000 * each['path_error_m']['value']:.1f}", each["rank"]) for each in scores]
        return ", ".join(error if ranked else f"({error})" for error, ranked in shown)

    rows = [[f"`{name}`", *(errors(each, name) for each in found.values())] for name in names]
    return table(["Policy", *(f"`{scenario}`" for scenario in found)], rows, "---")


def gaps(results: Path, scenario: str) -> str:
    """Stored less fresh path error: a line for each policy, a column for each pace."""
    own = [gap for gap in summary(results)["gaps"] if gap["scenario"] == scenario and gap["policy"] not in LEFT_OUT]
    names = dict.fromkeys(gap["policy"] for gap in sorted(own, key=lambda gap: gap["fresh_m"]["value"]))
    found = {
        (gap["policy"], gap["pace"]): [1000 * gap["gap_m"][key] for key in ("value", "low", "high")] for gap in own
    }

    def text(numbers: Sequence[float] | None) -> str:
        if numbers is None:
            return ""
        value, low, high = (f"{each:+z.2f}" for each in numbers)
        return joined(signed(f"{value} ({low} … {high})"))

    return table(
        ["Policy", *PACES], ([f"`{name}`", *(text(found.get((name, pace))) for pace in PACES)] for name in names), "---"
    )


def against_tuned(results: Path) -> str:
    """The learned policy beside the best tuned law of each scenario at each pace, each on fresh episodes of its own."""
    groups: dict[tuple[str, str], list[ScenarioRun]] = {each: [] for each in product(SCENARIOS, PACES)}
    for run in ResultsFolder(results).runs():
        if run.conditions.fresh is not None:
            groups[run.conditions.scenario, run.conditions.pace].append(run)
    rows: list[list[str]] = []
    kinds = ("Larger path error", "An interval that contains 0", "Not ranked", "Higher peak acceleration")
    exceptions: dict[str, list[str]] = {kind: [] for kind in kinds}
    for (scenario, pace), runs in groups.items():
        found = {run.conditions.policy: run for run in runs}
        law = rank([run for run in runs if run.conditions.policy.endswith("-tuned")]).standings[0]
        mine = rank([found[LEARNED]]).standings[0]
        both = [found[name].scores["path_error_m"] for name in (LEARNED, law.policy)]
        difference = unpaired_interval(*both, strata=(found[LEARNED].strata, found[law.policy].strata))
        errors = [1000 * each.scores["path_error_m"].value for each in (law, mine)]
        peaks = [each.scores["peak_acceleration_m_s2"].value for each in (mine, law)]
        value, low, high = (signed(f"{1000 * number:+z.1f}") for number in difference)
        ranked = [
            f"{error:.1f}{'' if each.rank else f' {BELOW}'}" for error, each in zip(errors, (law, mine), strict=True)
        ]
        rows.append(
            [
                f"`{scenario}`",
                pace,
                f"`{law.policy}`",
                *ranked,
                f"{100 * errors[1] / errors[0]:.0f}",
                f"{value} ({low} … {high})",
                f"{peaks[0]:.1f} for {peaks[1]:.1f}",
            ]
        )
        where = f"`{scenario}` {pace}"
        shares = difference.low <= 0.0 <= difference.high
        holds = (difference.low > 0.0, shares, not mine.rank, peaks[0] > peaks[1])
        for kind, holding in zip(kinds, holds, strict=True):
            exceptions[kind] += [where] if holding else []
    header = ["Scenario", "Pace", "Best tuned law", "Its error [mm]", f"`{LEARNED}` [mm]", "Share [%]"]
    told = [f"- {kind}: {', '.join(places)}.\n" for kind, places in exceptions.items() if places]
    text = table([*header, "Difference [mm]", "Peak acceleration [m/s²]"], rows, "---")
    return text + (f"\nWhere `{LEARNED}` is not better:\n\n{''.join(told)}" if told else "")


def by_seed(results: Path) -> str:
    """One line for each policy and training seed and one for the median; an opponent has the seed of its episodes."""
    found: dict[str, dict[int, dict[str, Board]]] = {}
    for board in summary(results)["leaderboards"]:
        for policy, scores in board["policies"].items():
            named = SEEDED.fullmatch(policy)
            name, seed = (named["name"], int(named["seed"])) if named else (policy, board["fresh"])
            found.setdefault(name, {}).setdefault(seed, {})[board["pace"]] = scores

    def text(scores: Board) -> str:
        error = f"{1000 * scores['path_error_m']['value']:.1f}"
        shown, arrives = error if scores["rank"] else f"({error})", scores["completed"]["value"]
        return shown if arrives >= 0.995 else f"{shown} {100 * arrives:.0f} %"

    rows: list[list[str]] = []
    for name, seeds in sorted(found.items()):
        rows += [[f"`{name}`", str(seed), *(text(at[pace]) for pace in PACES)] for seed, at in sorted(seeds.items())]
        middle = [median(1000 * at[pace]["path_error_m"]["value"] for at in seeds.values()) for pace in PACES]
        rows.append([f"`{name}`", "median", *(f"**{error:.1f}**" for error in middle)])
    return table(["Policy", "Seed", *PACES], rows, "---")


def data_sets(data: Path) -> str:
    """One line for each data set in a folder of `pter record`."""
    from pter_gym.tools.datasets import LEVELS, dataset_id

    rows: list[list[str]] = []
    for scenario, level in product(("standard", "everything"), LEVELS):
        name = dataset_id(scenario, level)
        card = json.loads((data / name / "data" / "metadata.json").read_text("utf-8"))["summary"]
        cells = [
            signed("{:.1f} ({:.1f} … {:.1f})".format(*(factor * each for each in card[score])))
            for score, factor in (("mean_return", 1.0), ("arrived", 100.0), ("distance_m", 1000.0))
        ]
        size = (data / name / "data" / "main_data.hdf5").stat().st_size / 1e6
        rows.append([f"`{name}`", f"{card['steps']:,}", f"{card['episodes']:,}", *cells, f"{size:.0f}"])
    head = ["Data set", "Control steps", "Episodes", "Mean return", "Arrive [%]", "Distance [mm]", "MB"]
    return table(head, rows)
