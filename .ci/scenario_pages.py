"""Put the leaderboards of a results folder into the docs and README.md: `python .ci/scenario_pages.py RESULTS`."""

import sys
from pathlib import Path

from pages import LEFT_OUT, ROOT, joined, read_boards, write_block

from pter_gym.scenarios import SCENARIOS

DOCS = ROOT / "docs" / "scenarios"
HEAD = """| | Policy | Path error [mm] | Arrives [%] | Mean pace off [%] | Segments off [%] | RMS acceleration [m/s²] |
|---|---|---|---:|---:|---:|---:|
"""


def row(name: str, s: dict) -> str:
    """One policy's line."""
    low, value, high = (1000 * s["path_error_m"][key] for key in ("low", "value", "high"))
    percent = [f"{100 * s[key]['value']:.3g}" for key in ("completed", "mean_pace_error", "segment_pace_error")]
    rank = "–" if s["rank"] is None else s["rank"]
    acceleration = f"{s['rms_acceleration_m_s2']['value']:.2f}"
    error = joined(f"{value:.1f} ({low:.1f} … {high:.1f})")
    return f"| {rank} | `{name}` | {error} | {' | '.join(percent)} | {acceleration} |\n"


def section(board: dict) -> str:
    """One leaderboard, and in words why some have no rank."""
    text = f"## {board['pace'].capitalize()}: {board['pace_m_s']:g} m/s, {board['episodes']} episodes\n\n{HEAD}"
    text += "".join(row(name, scores) for name, scores in board["policies"].items())
    below = [f"- `{name}` {scores['reason']}." for name, scores in board["policies"].items() if scores["reason"]]
    return text + ("\nBelow the line:\n\n" + "\n".join(below) + "\n" if below else "")


def summary(boards: list[dict]) -> str:
    """One line for each policy, one column for each scenario."""
    scenarios = [name for name in SCENARIOS if any(board["scenario"] == name for board in boards)]
    first = next(board["policies"] for board in boards if board["scenario"] == scenarios[0])
    names = [name for name in first if name not in LEFT_OUT]
    lines = [f"| Policy | {' | '.join(f'`{each}`' for each in scenarios)} |\n|---|{'---|' * len(scenarios)}\n"]
    for name in sorted(names, key=lambda name: first[name]["path_error_m"]["value"]):
        cells = []
        for scenario in scenarios:
            found = [board["policies"][name] for board in boards if board["scenario"] == scenario]
            errors = [f"{1000 * s['path_error_m']['value']:.1f}" for s in found]
            cells.append(", ".join(e if s["rank"] else f"({e})" for e, s in zip(errors, found, strict=True)))
        lines.append(f"| `{name}` | {' | '.join(cells)} |\n")
    return "".join(lines)


boards = read_boards(Path(sys.argv[1]))
for scenario in {board["scenario"] for board in boards}:
    page = DOCS / f"{scenario}.md"
    write_block(page, "scores", "\n".join(section(board) for board in boards if board["scenario"] == scenario))
    print(page)
write_block(ROOT / "README.md", "suite", summary(boards))
