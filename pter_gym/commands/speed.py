"""``pter speed``: the simulator's speed beside its peers."""

import json
from pathlib import Path

from rich.console import Console

from pter_gym.internal.terminal import make_folder


def speed(quick: bool = False, max_worlds: int = 4_000_000, out: Path = Path("pter-speed")) -> None:
    """Measure the simulator's speed beside its peers.

    Takes a few minutes, prints tables, and writes speed.json, speed.png and speed.pdf. Peers that are not installed
    (MuJoCo, EnvPool) and a GPU that is not there are skipped and named. The machine should have nothing else to do.

    Example: pter speed --quick

    Args:
        quick: Half a minute, small batches: whether it works, not how fast it is.
        max_worlds: Largest number of worlds; a CPU gets at most 1,000,000.
        out: Folder for the results; made if need be.
    """
    from pter_gym.internal.files import write_text_atomic
    from pter_gym.plots import save
    from pter_gym.speed import as_json, make_plan, measure, notes, tables
    from pter_gym.speed.plot import cost_figure

    plan = make_plan(quick=quick, max_worlds=max_worlds)
    make_folder(out)
    console = Console()
    with Console(stderr=True).status("speed") as status:
        found = measure(plan, lambda what: status.update(f"measuring {what}"))
    for table in tables(found):
        console.print(table)
        console.print()
    for note in notes(found):
        console.print(note, highlight=False)
    write_text_atomic(out / "speed.json", json.dumps(as_json(found), indent=2) + "\n")
    for path in (out / "speed.json", *save(cost_figure(found), out / "speed.png")):
        console.print(f"wrote {path}", highlight=False)
