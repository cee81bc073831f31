"""Put the leaderboards of a results folder into the docs and README.md: `python docs/make/scenario_pages.py RESULTS`.

RESULTS is a folder of `pter benchmark`, of which `benchmark.json` alone is read. Of several numbers of episodes of a
scenario at a pace, the largest counts; README's picture shows each policy on the most episodes that it has.
"""

from pathlib import Path

import tyro
from figures.pages import Score, error_against_commanded_pace
from pages import (
    IMAGES,
    LEFT_OUT,
    ROOT,
    board_table,
    episodes_text,
    joined,
    path_error,
    read_boards,
    read_summary,
    signed,
    table,
    write_block,
)

from pter_gym.benchmark.statistics import Interval
from pter_gym.internal.looks import LOOKS
from pter_gym.plots import save
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import PACES, SCENARIOS

DOCS = ROOT / "docs" / "scenarios"
PICTURE = IMAGES / "error-against-pace.png"
PICTURED = "standard"
IN_README = ["residual", "single-dof-tuned", "torque-feedback"]
PRIVILEGED = "predictive"  # knows what no robot can, so it is no part of the suite
HEAD = """| | Policy | Path error [mm] | Arrives [%] | Mean pace off [%] | Segments off [%] | RMS acceleration [m/s²] |
|---|---|---|---:|---:|---:|---:|
"""


def row(name: str, s: dict) -> str:
    """One policy's line."""
    percent = [f"{100 * s[key]['value']:.3g}" for key in ("completed", "mean_pace_error", "segment_pace_error")]
    rank = "–" if s["rank"] is None else s["rank"]
    acceleration = f"{s['rms_acceleration_m_s2']['value']:.2f}"
    return f"| {rank} | `{name}` | {joined(path_error(s))} | {' | '.join(percent)} | {acceleration} |\n"


def section(board: dict) -> str:
    """One leaderboard, and in words why some have no rank."""
    text = f"## {board['pace'].capitalize()}: {board['pace_m_s']:g} m/s\n\n{episodes_text(board)}:\n\n{HEAD}"
    text += "".join(row(name, scores) for name, scores in board["policies"].items())
    below = [f"- `{name}` {scores['reason']}." for name, scores in board["policies"].items() if scores["reason"]]
    return text + ("\nBelow the line:\n\n" + "\n".join(below) + "\n" if below else "")


def summary(boards: list[dict]) -> str:
    """One line for each policy, one column for each scenario."""
    scenarios = [name for name in SCENARIOS if any(board["scenario"] == name for board in boards)]
    first = next(board["policies"] for board in boards if board["scenario"] == scenarios[0])
    names = [name for name in first if name not in (*LEFT_OUT, PRIVILEGED)]
    lines = [f"| Policy | {' | '.join(f'`{each}`' for each in scenarios)} |\n|---|{'---|' * len(scenarios)}\n"]
    for name in sorted(names, key=lambda name: first[name]["path_error_m"]["value"]):
        cells = []
        for scenario in scenarios:
            own = [board["policies"] for board in boards if board["scenario"] == scenario]
            found = [policies[name] for policies in own if name in policies]
            errors = [f"{1000 * s['path_error_m']['value']:.1f}" for s in found]
            cells.append(", ".join(e if s["rank"] else f"({e})" for e, s in zip(errors, found, strict=True)))
        lines.append(f"| `{name}` | {' | '.join(cells)} |\n")
    return "".join(lines)


def shown_names(boards: list[dict]) -> list[str]:
    """The policies of all leaderboards but those that anybody is better than, in the order in which they come."""
    return list(dict.fromkeys(name for board in boards for name in board["policies"] if name not in LEFT_OUT))


def gap_table(gaps: list[dict]) -> str:
    """Stored less fresh path error of ``PICTURED`` with intervals: a line for each policy, a column for each pace."""
    own = [gap for gap in gaps if gap["scenario"] == PICTURED and gap["policy"] not in LEFT_OUT]
    names = list(dict.fromkeys(gap["policy"] for gap in sorted(own, key=lambda gap: gap["fresh_m"]["value"])))
    cells = {(gap["policy"], gap["pace"]): gap["gap_m"] for gap in own}
    rows = [[f"`{name}`", *(gap_text(cells.get((name, pace))) for pace in PACES)] for name in names]
    return table(["Policy", *PACES], rows, "---")


def gap_text(gap: dict | None) -> str:
    """A gap in mm with its interval."""
    if gap is None:
        return ""
    value, low, high = (1000 * gap[key] for key in ("value", "low", "high"))
    return joined(signed(f"{value:+z.2f} ({low:+z.2f} … {high:+z.2f})"))


def largest(boards: list[dict]) -> list[dict]:
    """For each scenario and pace the leaderboard on the most episodes, in the order given."""
    best: dict[tuple[str, str], dict] = {}
    for board in sorted(boards, key=lambda board: board["episodes"]):
        best[board["scenario"], board["pace"]] = board
    return [board for board in boards if best[board["scenario"], board["pace"]] is board]


def fronts(boards: list[dict]) -> dict[str, list[Score]]:
    """Scores at all paces by policy, each on the most episodes that it has."""
    names = {name for board in boards for name in board["policies"]} & {*LOOKS, *shipped_policies()} - {*LEFT_OUT}
    found: dict[str, list[Score]] = {}
    for name in sorted(names):
        own = largest([board for board in boards if name in board["policies"]])
        for board in sorted(own, key=lambda board: board["pace_m_s"]):
            s = board["policies"][name]
            error = Interval(**s["path_error_m"])
            found.setdefault(name, []).append(Score(board["pace_m_s"], error, s["rank"] is not None))
    return {name: front for name, front in found.items() if len(front) == len(PACES)}


def draw(boards: list[dict]) -> None:
    """README's picture of one scenario."""
    shown = fronts(boards)
    count = max(board["episodes"] for board in boards)
    kind = "stored" if boards[0]["fresh"] is None else "fresh"
    note = f"{PICTURED}, {count} {kind} episodes; bars: 95 % intervals"
    for name in shown:
        own = max(board["episodes"] for board in boards if name in board["policies"])
        note += f"\n{name}: {own} episodes" if own < count else ""
    for path in save(error_against_commanded_pace(shown, note), PICTURE):
        print(f"wrote {path}")


def main(results: tyro.conf.Positional[Path]) -> None:
    """Put the leaderboards of a results folder into the docs and README.md."""
    every = read_boards(results)
    boards = largest(every)
    for scenario in sorted({board["scenario"] for board in boards}):
        found = "\n".join(section(board) for board in boards if board["scenario"] == scenario)
        write_block(DOCS / f"{scenario}.md", "scores", found)
        print(DOCS / f"{scenario}.md")
    suite = DOCS / "index.md"
    write_block(suite, "suite", summary(boards))
    write_block(suite, "board: everything", board_table(boards, "everything", shown_names(boards)))
    write_block(ROOT / "README.md", f"board: {PICTURED}", board_table(boards, PICTURED, IN_README))
    if gaps := read_summary(results)["gaps"]:
        write_block(suite, "gap", gap_table(gaps))
    if any(board["scenario"] == PICTURED for board in boards):
        draw([board for board in every if board["scenario"] == PICTURED])


if __name__ == "__main__":
    tyro.cli(main)
