"""``pter tune``: the search for a law's gains."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import tyro

from pter_gym._commands.arguments import (
    AnyPace,
    HandName,
    MachineName,
    PathName,
    ScenarioName,
    Smoothness,
    check_file,
    look_at,
    options,
    scenario_on,
    smoothing_for,
)
from pter_gym._commands.terminal import conclude, progress_bar, say
from pter_gym.errors import ParameterError
from pter_gym.policies.find import kind_of


def tune(
    law: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME|FILE.py:LAW")] = "",
    scenario: ScenarioName = "standard",
    pace: AnyPace = "medium",
    path: PathName = None,
    smooth: Smoothness = 0.0,
    trials: int = 3000,
    episodes: int = 200,
    storage: Path = Path("pter-tune.journal"),
    seed: int = 0,
    out: Path | None = None,
    replace: bool = False,
    machine: MachineName = None,
    worst: bool = False,
    hand: HandName = None,
) -> None:
    """Search for a law's gains.

    Tries gains on training episodes of a scenario, at a commanded pace, beginning with the shipped
    ones. The trials are kept in a journal file, so an interrupted search continues where it left
    off, and several processes may share the work. The best gains have the smallest path error
    among those that arrive and keep the pace. Needs the extra tune.

    Example: pter tune impedance --scenario standard --pace medium --out gains.toml

    Args:
        law: Name of a control law, or FILE.py:Law for your own, whose `search` holds the ranges
            of its gains.
        scenario: Scenario whose training episodes are used.
        pace: Commanded pace: slow, medium, brisk, or a speed in m/s.
        path: Path instead of the scenario's: a CSV file of waypoints x, y in metres, or a path's
            name.
        smooth: Noise to remove from a recorded path, root mean square, in mm.
        trials: Gains to try, at least 1.
        episodes: Training episodes for each trial, at least 1.
        storage: Journal file of the trials; its folder must exist.
        seed: Seed of the episodes and the search, at least 0.
        out: TOML file for the best gains of a named law, which `pter benchmark --policies`
            and others accept; its other entries are kept. By default they are only printed.
        replace: Replace the gains that --out already holds for the law, scenario and pace.
        machine: Name or file of a machine, instead of the scenario's.
        worst: Minimise the largest path error of the episodes instead of the mean.
        hand: Name or file of a hand, instead of the scenario's; of a file of `pter identify
            --hand`, all hands that fit the log. See docs/hands.md.
    """
    kind = kind_of(law, "law", ("law", "code"))
    look_at(paces=[pace], path=path, smooth=smooth, machine=machine, hand=hand)
    if out is not None:
        from pter_gym.policies.tuned import guided

        check_file(out, ".toml")
        if law not in guided():
            raise ParameterError(
                "out must be left out for a law of your own: put the printed gains into its file"
            )

    from pter_gym.controllers import CONTROLLERS
    from pter_gym.scenarios.paces import name_of_pace
    from pter_gym.tools.tuning.gains_file import add_gains, check_place
    from pter_gym.tools.tuning.search import command_of, tune as search

    definition = scenario_on(scenario, machine, path, smooth, hand)
    arguments: dict[str, Any] = {
        "trials": trials,
        "episodes": episodes,
        "seed": seed,
        "machine": machine,
        "path": path,
        "smooth": 1e-3 * smooth,
        "worst": worst,
        "hand": hand,
    }
    if out is not None:
        at = name_of_pace(pace)
        command = command_of(law, scenario, at, **arguments)
        check_place(out, definition, law, at, command, replace=replace)
    title = f"{law}, {scenario}, {pace}"
    with progress_bar() as progress:
        task = progress.add_task(title, total=trials)

        def show(finished: int, best: float) -> None:
            progress.update(task, completed=finished, description=f"{title}: {1000 * best:.1f} mm")

        tuned = search(law, scenario, pace, storage=storage, on_trial=show, **arguments)
    gains = ", ".join(f"{name}={gain!r}" for name, gain in tuned.gains.items())
    called = law.rpartition(":")[2]
    if kind == "law":
        called = type(CONTROLLERS[law]()).__name__
        say(f"from pter_gym.controllers import {called}\n")
    say(f"{called}({gains})\n")
    say(f"on other episodes: {tuned.assessment}")
    smooth = smooth or smoothing_for(definition)
    same = options(
        scenario=scenario, pace=pace, path=path, machine=machine, hand=hand, smooth=smooth
    )
    if out is not None:
        add_gains(tuned, out, replace=replace)
    conclude(
        [out] if out else [],
        f"pter benchmark --policies {quote(str(out or law))} single-dof-tuned{same}",
    )
