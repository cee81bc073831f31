"""What the scripts that write pages share: the leaderboards of a results folder, and blocks between two comments."""

import json
import re
from pathlib import Path

from pter_gym.benchmark.ranking import PRIVILEGED
from pter_gym.internal.files import write_text_atomic
from pter_gym.scenarios import PACES

ROOT = Path(__file__).parents[2]
AGENTS = ROOT / "docs" / "agents.md"
IMAGES = ROOT / "docs" / "images"
LEFT_OUT = ("free", "locked", "random")
BELOW = "†"


def read_summary(results: Path) -> dict:
    """What `benchmark.json` holds in a folder of `pter benchmark`."""
    return json.loads((results / "benchmark.json").read_text("utf-8"))


def read_boards(results: Path) -> list[dict]:
    """The leaderboards of a folder of `pter benchmark`; of a scenario with fresh episodes, those alone."""
    boards = read_summary(results)["leaderboards"]
    fresh = {board["scenario"] for board in boards if board["fresh"] is not None}
    return [board for board in boards if (board["fresh"] is not None) == (board["scenario"] in fresh)]


def episodes_text(board: dict) -> str:
    """Which episodes a leaderboard has, in words."""
    kind = "stored episodes" if board["fresh"] is None else f"fresh episodes, seed {board['fresh']}"
    return f"{board['episodes']:,} {kind}"


def write_block(page: Path, name: str, content: str) -> None:
    """Put content between `<!-- name -->` and `<!-- /name -->`, which must be in the page once."""
    block = re.compile(rf"<!-- {name} -->\n.*?<!-- /{name} -->\n", re.DOTALL)
    text, count = block.subn(lambda _: f"<!-- {name} -->\n{content}<!-- /{name} -->\n", page.read_text("utf-8"))
    if count != 1:
        raise ValueError(f"{page} must have one block {name!r}, but has {count}")
    write_text_atomic(page, text)


def put_block(page: Path, name: str, content: str, *, write: bool) -> None:
    """Put content into a page, or print it."""
    if write:
        write_block(page, name, content)
    else:
        print(content)


def table(header: list[str], rows: list[list[str]], align: str = "---:") -> str:
    """A table whose first column is text and whose others are aligned to the right."""
    line = f"|---|{f'{align}|' * (len(header) - 1)}\n"
    return f"| {' | '.join(header)} |\n{line}" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def joined(text: str) -> str:
    """The text with spaces at which no line breaks."""
    return text.replace(" ", "\u00a0")


def signed(text: str) -> str:
    """The text with typographic minus signs."""
    return text.replace("-", "−")


def path_error(scores: dict) -> str:
    """Path error in mm with its interval."""
    low, value, high = (1000 * scores["path_error_m"][key] for key in ("low", "value", "high"))
    return f"{value:.1f} ({low:.1f} … {high:.1f})"


def label(name: str, scores: dict) -> str:
    """The name of a policy, marked if it knows what no controller can."""
    return f"`{name}`{' (privileged)' if scores['privileged'] else ''}"


def error_cell(scores: dict, *, details: bool) -> str:
    """Path error in mm with its interval; with details, arrivals and pace errors; marked below the line."""
    text = joined(path_error(scores) + ("" if scores["reason"] in (None, PRIVILEGED) else f" {BELOW}"))
    if not details:
        return text
    arrives, mean, segments = (
        100 * scores[key]["value"] for key in ("completed", "mean_pace_error", "segment_pace_error")
    )
    return f"{text}; {arrives:.3g} %, ±{mean:.0f} %, ±{segments:.0f} %"


def board_table(boards: list[dict], scenario: str, names: list[str], *, details: bool = False) -> str:
    """Policies over paces for one scenario, best at the first pace first."""
    found = {board["pace"]: board for board in boards if board["scenario"] == scenario}
    missing = [pace for pace in PACES if pace not in found]
    if missing:
        raise ValueError(f"the results have no {scenario} at {', '.join(missing)}")
    (episodes,) = {episodes_text(board) for board in found.values()}
    paces = [f"{pace} ({speed:g} m/s)" for pace, speed in PACES.items()]
    shown = [name for name in names if all(name in found[pace]["policies"] for pace in PACES)]
    errors = {name: [found[pace]["policies"][name] for pace in PACES] for name in shown}
    rows = [
        [label(name, errors[name][0]), *(error_cell(scores, details=details) for scores in errors[name])]
        for name in sorted(shown, key=lambda name: errors[name][0]["path_error_m"]["value"])
    ]
    return f"`{scenario}`, {episodes}:\n\n" + table(["Policy", *paces], rows, "---")
