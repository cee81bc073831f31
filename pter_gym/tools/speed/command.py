"""``pter speed``: the simulator's speed beside its peers."""

import json
from pathlib import Path
from typing import Annotated

from pter_gym._commands.arguments import at_least
from pter_gym._internal.terminal import make_folder, say, terminal


def speed(
    quick: bool = False, max_worlds: Annotated[int, at_least(1)] = 4_000_000, out: Path = Path("pter-speed")
) -> None:
    """Measure the simulator's speed and compare it with its peers.

    Takes two minutes, prints tables, and writes speed.json, speed.png and speed.pdf. Peers that are not installed
    (MuJoCo, EnvPool) and a missing GPU are listed as skipped. The machine should be otherwise idle.

    Example: pter speed --quick

    Args:
        quick: Check within half a minute that everything works; small batches, so not how fast it is.
        max_worlds: Largest number of worlds; a CPU gets at most 1,000,000.
        out: Folder for the results, created if necessary.
    """
    from pter_gym._internal.files import write_text_atomic
    from pter_gym.tools.figures import save
    from pter_gym.tools.speed import as_json, make_plan, measure, notes, tables
    from pter_gym.tools.speed.plot import cost_figure

    plan = make_plan(quick=quick, max_worlds=max_worlds)
    make_folder(out)
    with terminal(errors=True).status("speed") as status:
        found = measure(plan, lambda what: status.update(f"measuring {what}"))
    try:
        write_text_atomic(out / "speed.json", json.dumps(as_json(found), indent=2) + "\n")
        written = out / "speed.json", *save(cost_figure(found), out / "speed.png")
    finally:
        for table in tables(found):
            terminal().print(table, "")
        for note in notes(found):
            say(note)
    for path in written:
        say(f"wrote {path}")
