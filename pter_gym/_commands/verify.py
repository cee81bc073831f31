"""``pter verify``: whether scores really are those of the policies that they name."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import tyro

from pter_gym._commands.arguments import split
from pter_gym._internal.terminal import progress_bar, say


def verify(
    results: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RESULTS")],
    policies: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = "",
    seed: int = 0,
) -> int:
    """Repeat the runs in a results folder and compare scores.

    Prints for each file what differs, or why it can't be run again; the exit status is 1 unless all are the same. The
    measured time per decision is not compared.

    Built-in and exported policies are found by name, as in `pter benchmark`. Code that the results name is
    imported only if you name it here, in a separate process; `pter_gym.benchmark.verify` takes other callables.

    Example: pter verify pter-benchmark

    Args:
        results: Folder of `pter benchmark --out`.
        policies: Policies as package.module:attribute that may be imported, separated by commas.
        seed: Seed of the random policy, at least 0.
    """
    from pter_gym.benchmark import Isolated, ResultsFolder
    from pter_gym.benchmark import verify as run_again
    from pter_gym.benchmark._naming import is_code

    with ExitStack() as processes, progress_bar() as progress:
        known = {name: processes.enter_context(Isolated(name)) for name in split(policies) if is_code(name)}
        task = progress.add_task("verify", total=None)
        verdicts = run_again(
            ResultsFolder(results), known, seed=seed, on_progress=lambda file: progress.update(task, description=file)
        )
    for verdict in verdicts:
        say(f"{verdict.file}: {verdict.finding}")
    same = sum(verdict.same for verdict in verdicts)
    say(f"{same} of {len(verdicts)} files are the same")
    return 0 if same == len(verdicts) else 1
