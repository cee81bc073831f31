"""``pter verify``: whether scores really are those of the policies that they name."""

from pathlib import Path
from typing import Annotated

import tyro

from pter_gym._internal.terminal import progress_bar, say


def verify(results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RESULTS")]) -> int:
    """Repeat the runs in a results folder and compare scores bit for bit.

    Prints for each file whether it is the same, what differs, or why it cannot be run again; the
    exit status is 1 unless all are the same. Policies are found by name, as in `pter benchmark`,
    but no code is imported.

    Example: pter verify pter-benchmark

    Args:
        results: Folder of `pter benchmark --out`.
    """
    from pter_gym.benchmark import verify as repeat

    with progress_bar() as progress:
        task = progress.add_task("verify", total=None)
        verdicts = repeat(results, on_progress=lambda file: progress.update(task, description=file))
    for verdict in verdicts:
        say(f"{verdict.file}: {verdict.finding}")
    same = sum(verdict.same for verdict in verdicts)
    say(f"{same} of {len(verdicts)} files are the same")
    return 0 if same == len(verdicts) else 1
