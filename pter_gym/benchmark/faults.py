"""How policies do in the same episodes if a clutch fails and they are not told."""

from collections.abc import Sequence
from typing import Any

from pter_gym.benchmark.boards import Leaderboard, Standing, in_order
from pter_gym.benchmark.cells import WIDTH, millimetres, shorten
from pter_gym.params import Machine
from pter_gym.scenarios.paces import title_of_pace
from pter_gym.tasks.path_following import Failure

WEAK, HELD = 0.5, 0.25
"""Share of its torque that a weak clutch gives, of the largest voltage that one stuck on has."""

FAULT = ", clutch "
"""What follows the name of a scenario whose clutch of this number fails."""


def faults(machine: Machine) -> dict[str, Failure]:
    """Return what may fail of a machine, by what follows the name of a scenario with it."""
    kinds: dict[str, dict[str, Any]] = {
        "dead": {"torque": 0.0},
        "half": {"torque": WEAK},
        "stuck on": {"volts": HELD * machine.clutch.voltage_max},
    }
    return {
        f"{FAULT}{clutch} {name}": Failure(clutch=clutch, **kind)
        for clutch in range(1, 1 + len(machine.clutches))
        for name, kind in kinds.items()
    }


def is_healthy(board: Leaderboard) -> bool:
    """Return whether nothing fails in the episodes of a leaderboard."""
    return FAULT not in board.scenario


def fault_table(boards: Sequence[Leaderboard]) -> list[list[str]]:
    """Return a table of leaderboards at one pace: a row for what fails, a column for each policy.

    Policies are in the order of their errors where something fails. Cells are the mean path error
    [mm], and the share that arrives where that is not all.
    """
    names = list(in_order([board for board in boards if not is_healthy(board)]))
    rows = [["", *names]]
    for board in boards:
        standings = {each.policy: each for each in board.standings}
        title = (
            "healthy" if is_healthy(board) else board.scenario[board.scenario.index(FAULT) + 2 :]
        )
        rows.append([title, *(_cell(standings.get(name)) for name in names)])
    return rows


def _cell(standing: Standing | None) -> str:
    if standing is None:
        return ""
    share = standing.scores["completed"]
    arrive = "" if share == 1.0 else f" ({100.0 * share:.0f} %)"
    return millimetres(standing.error.value) + arrive


def faults_text(boards: Sequence[Leaderboard]) -> str:
    """Return a table for each pace of a scenario, for 80 columns."""
    parts: list[str] = []
    for first in filter(is_healthy, boards):
        rows = fault_table([board for board in boards if board.pace == first.pace])
        longest = max(len(row[0]) for row in rows)
        room = (WIDTH - longest) // (len(rows[0]) - 1) - 2
        rows[0] = [shorten(name, max(room, 3)) for name in rows[0]]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        title = f"{first.title}, {title_of_pace(first.pace)}: path error [mm] if a clutch fails"
        lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
        parts += [title, "", *lines, ""]
    note = "In brackets how many arrive, if not all do. The policies are not told what fails."
    return "\n".join([*parts, note, ""])
