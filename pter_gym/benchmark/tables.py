"""Leaderboards as a table for a paper: in Markdown, LaTeX or CSV."""

import csv
import io
import itertools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pter_gym._internal.files import FilePath, expand_path, has_ending, write_text_atomic
from pter_gym.benchmark.boards import EPISODE_SET, Leaderboard, Standing, in_order
from pter_gym.benchmark.cells import UNRANKED, in_brackets, with_interval
from pter_gym.benchmark.intervals import Interval, difference_interval
from pter_gym.errors import ParameterError
from pter_gym.scenarios.paces import find_pace, title_of_pace

ENDINGS = (".md", ".tex", ".csv")
"""Of files with a table: Markdown, LaTeX and CSV."""

LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "–": "--",
    "−": "$-$",
    UNRANKED: r"$\dagger$",
}
"""What signs become in LaTeX."""

TABLE_ENTRIES = (
    "scenario",
    "pace_m_s",
    "policy",
    "episodes",
    "seed",
    "rank",
    "reason",
    "path_error_m",
    "path_error_low_m",
    "path_error_high_m",
    "difference_m",
    "difference_low_m",
    "difference_high_m",
    "completed",
    "worst_hand_m",
)
"""Of a CSV file; a difference is to the baseline, over the same episodes."""


class Cell(NamedTuple):
    """A policy on a leaderboard, and how much larger its error is than the baseline's [m]."""

    standing: Standing | None
    is_best: bool
    difference: Interval | None


def check_table(path: FilePath) -> None:
    """Raise a ParameterError unless a file's ending names a kind of table."""
    if not has_ending(path, *ENDINGS):
        raise ParameterError(f"table must end in {', '.join(ENDINGS)}, got {str(path)!r}")


def write_table(
    path: FilePath, boards: Sequence[Leaderboard], *, baseline: str | None = None, command: str = ""
) -> Path:
    """Write leaderboards as a table to a file, whose ending selects the format; return its path.

    Differences to a baseline are a table of their own, so that both fit on a page; in CSV, columns.

    Parameters
    ----------
    boards
        Leaderboards, those of a scenario one after another.
    baseline
        Policy to which differences are given, with intervals over the same episodes.
    command
        Command that reproduces the table, for its caption.

    Raises
    ------
    ParameterError
        If the ending is not one of ``ENDINGS``, or the baseline is not on all leaderboards.
    """
    check_table(path)
    for board in boards:
        names = [each.policy for each in board.standings]
        if baseline is not None and baseline not in names:
            raise ParameterError(
                f"baseline must be among {', '.join(names)} for {board.scenario}, got {baseline!r}"
            )
    file = expand_path("table", path)
    if has_ending(path, ".csv"):
        text = _csv(boards, baseline)
    else:
        text = (_latex if has_ending(path, ".tex") else _markdown)(boards, baseline, command)
    write_text_atomic(file, text)
    return file


def _rows(
    boards: Sequence[Leaderboard], baseline: str | None
) -> Iterator[tuple[Sequence[Leaderboard], str, list[Cell]]]:
    """Yield each scenario's leaderboards with each policy on them, and its cells by pace."""
    for _, same in itertools.groupby(boards, EPISODE_SET):
        at_paces = list(same)
        rows = in_order(at_paces)
        against = rows.get(baseline or "", [None] * len(at_paces))
        for name, standings in rows.items():
            yield (
                at_paces,
                name,
                [
                    Cell(each, bool(each and each.rank == 1), _difference(board, each, other))
                    for board, each, other in zip(at_paces, standings, against, strict=True)
                ],
            )


def _difference(
    board: Leaderboard, standing: Standing | None, baseline: Standing | None
) -> Interval | None:
    """Return the mean difference of two policies' path errors on the same episodes [m]."""
    if standing is None or baseline is None or standing is baseline:
        return None
    return difference_interval(standing.errors, baseline.errors, board.strata)


class Row(NamedTuple):
    """A policy on a scenario, in text: its errors and its differences to the baseline by pace."""

    scenario: str
    policy: str
    errors: list[str]
    differences: list[str]


def _texts(
    boards: Sequence[Leaderboard], baseline: str | None, bold: str
) -> tuple[list[str], list[Row]]:
    """Return the titles of the paces, and the rows."""
    paces = list(dict.fromkeys(board.pace for board in boards))
    rows: list[Row] = []
    for at_paces, name, cells in _rows(boards, baseline):
        by_pace = dict(zip((board.pace for board in at_paces), cells, strict=True))
        each = [by_pace.get(pace, Cell(None, False, None)) for pace in paces]
        differences = [
            with_interval(cell.difference, signed=True) if cell.difference else "" for cell in each
        ]
        errors = [_error(cell, bold) for cell in each]
        rows.append(Row(at_paces[0].scenario, name, errors, differences))
    return list(map(title_of_pace, paces)), rows


def _error(cell: Cell, bold: str) -> str:
    """Return a path error with its interval in mm, bold if it is the best, or with a mark."""
    if cell.standing is None:
        return ""
    value, ends = in_brackets(cell.standing.error)
    mark = UNRANKED if cell.standing.reason else ""
    return (bold.format(value) if cell.is_best else value) + mark + ends


def _caption(boards: Sequence[Leaderboard], command: str) -> list[str]:
    """Return the sentences below the table of errors."""
    counts = sorted({board.episodes for board in boards})
    some = " or ".join(f"{count:,}" for count in counts)
    seeds = {board.seed for board in boards}
    which = (
        "stored test episodes"
        if seeds == {None}
        else f"test episodes of seed {max(seeds, key=str)}"
    )
    sentences = [
        f"Path error [mm] with 95 % intervals on {some} {which}; bold: the best with a rank."
    ]
    if any(each.reason for board in boards for each in board.standings):
        sentences.append(
            f"{UNRANKED}: without a rank, as it arrives too rarely or is off the pace."
        )
    if any(len(each.errors) > 1 for board in boards for each in board.standings):
        sentences.append("Intervals of policies with several training seeds are over these.")
    made = f"Made with pter_gym {boards[0].version}"
    return [*sentences, f"{made}{f' by `{command}`' if command else ''}."]


def _tables(
    boards: Sequence[Leaderboard], baseline: str | None, command: str, bold: str
) -> Iterator[tuple[list[str], list[tuple[str, ...]], str]]:
    """Yield the paces, the rows and the caption of the errors, then those of the differences.

    A row holds a scenario, a policy and a text for each pace.
    """
    paces, rows = _texts(boards, baseline, bold)
    errors = [(row.scenario, row.policy, *row.errors) for row in rows]
    yield paces, errors, " ".join(_caption(boards, command))
    if baseline:
        others = [row for row in rows if row.policy != baseline]
        differences = [(row.scenario, row.policy, *row.differences) for row in others]
        yield paces, differences, f"Path error less that of {baseline} [mm], on the same episodes."


def _markdown(boards: Sequence[Leaderboard], baseline: str | None, command: str) -> str:
    """Return tables whose first column has a scenario once."""
    tables = _tables(boards, baseline, command, "**{}**")
    return "\n".join(_markdown_table(*each) for each in tables)


def _markdown_table(paces: list[str], rows: Sequence[tuple[str, ...]], caption: str) -> str:
    """Return a table with its caption below."""
    lines = [("Scenario", "Policy", *paces), ("---", "---", *["---:"] * len(paces))]
    for scenario, same in itertools.groupby(rows, lambda row: row[0]):
        first, *others = (cells for _, *cells in same)
        lines += [(scenario, *first), *(("", *cells) for cells in others)]
    plain = (" | ".join(cell.replace("|", r"\|") for cell in line) for line in lines)
    return "".join(f"| {line} |\n" for line in plain) + f"\n{caption}\n"


def _latex(boards: Sequence[Leaderboard], baseline: str | None, command: str) -> str:
    """Return tables that are narrower than a page."""
    tables = _tables(boards, baseline, command, "\0{}\1")  # braces are escaped
    text = "\n".join(_latex_table(*each) for each in tables)
    return f"% needs \\usepackage{{booktabs}}\n{text}"


def _latex_table(paces: list[str], rows: Sequence[tuple[str, ...]], caption: str) -> str:
    """Return a table, in which each scenario is a line of its own above its policies."""
    lines = [r"\begin{table}", r"\centering", r"\footnotesize", r"\setlength{\tabcolsep}{4pt}"]
    lines += [rf"\begin{{tabular}}{{@{{}}l{'r' * len(paces)}@{{}}}}", r"\toprule"]
    lines.append(_latex_row(["Policy", *paces]))
    for scenario, same in itertools.groupby(rows, lambda row: row[0]):
        title = rf"\emph{{{_escaped(scenario)}}}"
        lines += [r"\midrule", rf"\multicolumn{{{1 + len(paces)}}}{{l}}{{{title}}} \\"]
        lines += [_latex_row([_short(cell) for cell in cells]) for _, *cells in same]
    caption = _escaped(re.sub("`(.*?)`", "\2\\1\1", caption))
    lines += [r"\bottomrule", r"\end{tabular}", rf"\caption{{{caption}}}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def _short(cell: str) -> str:
    """Return a cell with commas in its intervals, and without decimals from 100 mm on."""
    return re.sub(r"(\d{3})\.\d", r"\1", cell).replace(" – ", ", ")


def _latex_row(cells: Sequence[str]) -> str:
    return " & ".join(map(_escaped, cells)) + r" \\"


def _escaped(text: str) -> str:
    signs = {"\0": r"\textbf{", "\2": r"\texttt{", "\1": "}", **LATEX}
    return "".join(signs.get(sign, sign) for sign in text)


def _csv(boards: Sequence[Leaderboard], baseline: str | None) -> str:
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(TABLE_ENTRIES)
    for at_paces, name, cells in _rows(boards, baseline):
        for board, (standing, _, difference) in zip(at_paces, cells, strict=True):
            if standing is None:
                continue
            worst = standing.worst and standing.worst.path_error_m
            rows.writerow(
                (
                    board.scenario,
                    find_pace(board.pace),
                    name,
                    board.episodes,
                    board.seed,
                    standing.rank,
                    standing.reason,
                    *standing.error,
                    *(difference or (None,) * 3),
                    standing.scores["completed"],
                    worst,
                )
            )
    return text.getvalue()
