"""Put the leaderboards of a results folder into docs/scenarios: `python .ci/scenario_pages.py RESULTS`."""

import json
import re
import sys
from pathlib import Path

from pter_gym.files import write_text_atomic

DOCS = Path(__file__).parents[1] / "docs" / "scenarios"
BLOCK = re.compile(r"<!-- scores -->\n.*?<!-- /scores -->\n", re.DOTALL)
HEAD = """| | Policy | Path error [mm] | Arrives [%] | Mean pace off [%] | Segments off [%] | RMS acceleration [m/s²] |
|---|---|---|---:|---:|---:|---:|
"""


def row(name: str, s: dict) -> str:
    """One policy's line."""
    low, value, high = (1000 * s["path_error_m"][key] for key in ("low", "value", "high"))
    percent = [f"{100 * s[key]['value']:.3g}" for key in ("completed", "mean_pace_error", "segment_pace_error")]
    rank = "–" if s["rank"] is None else s["rank"]
    acceleration = f"{s['rms_acceleration_m_s2']['value']:.2f}"
    return f"| {rank} | `{name}` | {value:.1f} ({low:.1f} … {high:.1f}) | {' | '.join(percent)} | {acceleration} |\n"


def section(board: dict) -> str:
    """One leaderboard, and in words why some have no rank."""
    text = f"## {board['pace'].capitalize()}: {board['pace_m_s']:g} m/s, {board['episodes']} episodes\n\n{HEAD}"
    text += "".join(row(name, scores) for name, scores in board["policies"].items())
    below = [f"- `{name}` {scores['reason']}." for name, scores in board["policies"].items() if scores["reason"]]
    return text + ("\nBelow the line:\n\n" + "\n".join(below) + "\n" if below else "")


boards = json.loads((Path(sys.argv[1]) / "benchmark.json").read_text("utf-8"))["leaderboards"]
for scenario in {board["scenario"] for board in boards}:
    page = DOCS / f"{scenario}.md"
    found = "\n".join(section(board) for board in boards if board["scenario"] == scenario)
    text = BLOCK.sub(lambda _, found=found: f"<!-- scores -->\n{found}<!-- /scores -->\n", page.read_text("utf-8"))
    write_text_atomic(page, text)
    print(page)
