"""``pter tune``: the search for a controller's gains."""

from pathlib import Path
from typing import Annotated, Any

import tyro

from pter_gym._commands.arguments import AnyPace, MachineName, PathName, ScenarioName, check_file
from pter_gym._internal.terminal import progress_bar, say
from pter_gym.errors import ParameterError


def tune(
    controller: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME|FILE.py:LAW")],
    scenario: ScenarioName = "standard",
    pace: AnyPace = "medium",
    path: PathName = None,
    trials: int = 3000,
    episodes: int = 200,
    storage: Path = Path("pter-tune.journal"),
    seed: int = 0,
    out: Path | None = None,
    machine: MachineName = None,
) -> None:
    """Search for a controller's gains.

    Tries gains on training draws of a scenario, at a commanded pace, beginning with the shipped
    ones. The trials are kept in a journal file, so an interrupted search continues where it left
    off, and several processes may share the work. The best gains have the smallest path error of
    all that arrive and keep the pace. Needs the extra tune.

    Example: pter tune impedance --scenario standard --pace medium --out gains.toml

    Args:
        controller: Name of a controller, or FILE.py:Law for your own, whose `search` holds the
            ranges of its gains.
        scenario: Scenario whose training draws are used; its evaluation episodes are never read.
        pace: Commanded pace: slow, medium, brisk, or a speed in m/s.
        path: Path instead of the scenario's: a CSV file of waypoints x, y in metres, or a path's
            name.
        trials: Gains to try, at least 1.
        episodes: Training draws for each trial, at least 1.
        storage: Journal file of the trials; its folder must exist.
        seed: Seed of the draws and the search, at least 0.
        out: TOML file for the best gains of a named controller, which `pter benchmark --policies`
            and others accept; its other entries are kept. By default they are only printed.
        machine: Clutch material, or the file of a machine of your own, instead of those that the
            scenario draws.
    """
    from pter_gym.benchmark.policies import is_code
    from pter_gym.tools.tuning.gains_file import add_gains
    from pter_gym.tools.tuning.search import tune as search

    if out is not None:
        check_file(out, ".toml")
        if is_code(controller):
            raise ParameterError(
                "out must be left out for a law of your own: put the printed gains into its file"
            )
    title = f"{controller}, {scenario}, {pace}"
    with progress_bar() as progress:
        task = progress.add_task(title, total=trials)

        def show(finished: int, best: float) -> None:
            progress.update(task, completed=finished, description=f"{title}: {1000 * best:.1f} mm")

        options: Any = {"trials": trials, "episodes": episodes, "storage": storage, "seed": seed}
        options |= {"machine": machine, "path": path}
        tuned = search(controller, scenario, pace, **options, on_trial=show)
    for name, gain in tuned.gains.items():
        say(f"{name} = {gain!r}")
    say(f"on other draws: {tuned.assessment}")
    if out is not None:
        add_gains(tuned, out)
        say(f"wrote {out}")
