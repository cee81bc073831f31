"""What the commands share about their arguments."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path, PurePath
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro

from pter_gym._commands.terminal import say
from pter_gym._internal.files import TABLE_ENDINGS, check_target, has_ending
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.hands._hand_files import find_impedance
from pter_gym.hands._library import LIBRARY_TREMORS
from pter_gym.params import find_machine
from pter_gym.paths._names import PATH_NAMES
from pter_gym.paths._reach import SINGULARITY_MARGIN, check_reach
from pter_gym.policies.find import kind_of
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario
from pter_gym.scenarios.paces import find_pace

ALL = "all"
"""All scenarios, or all paces."""

if TYPE_CHECKING:
    from pter_gym.scenarios import Scenario

    ScenarioName = AnyScenario = str
    PaceName = EachPace = str
else:
    ScenarioName = Literal[tuple(SCENARIOS)]
    """Name of a scenario; the help lists all."""

    AnyScenario = Literal[(ALL, *SCENARIOS)]
    """Name of a scenario, or all of them."""

    PaceName = Literal[tuple(PACES)]
    """Name of a commanded pace; the help lists all."""

    EachPace = Literal[(ALL, *PACES)]
    """Name of a commanded pace, or all of them."""

_PACE = f"{'|'.join(PACES)}|M/S"

AnyPace = Annotated[str, tyro.conf.arg(metavar=_PACE)]
"""A commanded pace, by its name or as a speed [m/s]."""

AnyPaces = Annotated[tuple[str, ...], tyro.conf.arg(metavar=f"{_PACE} …", aliases=("--pace",))]
"""Commanded paces, each as ``AnyPace``."""

Smoothness = Annotated[float, tyro.conf.arg(metavar="MM")]
"""How far a path from a file may pass by its waypoints [mm]."""

NARROW, NOISE = 0.02, 2.0
"""Half-width of a workspace [m] below which a path is probably noisy, and a usual noise [mm]."""

PathName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.csv")]
"""A path by its name, or a file of waypoints; None for what is usual."""

MachineName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.toml")]
"""A machine by its name or its file; None for what is usual."""

HandName = Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.toml")]
"""A hand by its name or its file; None for what is usual."""


def look_at(
    *,
    policies: Iterable[str] = (),
    paces: Iterable[str] = (),
    path: str | None = None,
    smooth: float = 0.0,
    machine: str | None = None,
    hand: str | None = None,
) -> None:
    """Look at what a user has named before anything that takes seconds is imported.

    What is mistyped, or out of reach, raises the error at once that it would later. A path that is
    smoothed does not pass through its waypoints, so these may be out of reach.
    """
    for pace in paces:
        find_pace(pace, "paces")
    for policy in policies:
        kind_of(policy)
    arm = find_machine(machine).arm
    if hand is not None and hand not in LIBRARY_TREMORS:
        find_impedance(hand)
    if path is not None and has_ending(path, *TABLE_ENDINGS):
        columns = read_table(path, ("x", "y"), unit="m").columns
        if not smooth:
            waypoints = np.stack([columns["x"], columns["y"]], axis=1)
            check_reach(waypoints, arm.length_a, arm.length_b, SINGULARITY_MARGIN)
    elif path is not None and path not in PATH_NAMES:
        raise unknown_name("path", path, (*PATH_NAMES, "FILE.csv"))


def scenario_on(
    scenario: str, machine: str | None, path: str | None, smooth: float, hand: str | None = None
) -> "Scenario":
    """Return a scenario on a user's path, with a user's machine and hand, each also in its name.

    Says so if the path's bends leave little workspace.
    """
    if smooth < 0.0 or (smooth and not has_ending(path, *TABLE_ENDINGS)):
        raise ParameterError(f"smooth must be ≥ 0 mm, for a path from a file, got {smooth:g}")
    chosen = find_scenario(scenario, machine, path, 1e-3 * smooth, hand)
    if machine:
        title = f"{chosen.name}-with-{PurePath(machine).stem}"
        chosen = replace(chosen, name=title, gains=chosen.whose_gains)
    if path and smoothing_for(chosen):
        width = chosen.draws.varied_task.template.error_max
        say(
            f"{path} bends so sharply that the workspace ends {1e3 * width:.2g} mm beside it; "
            f"for a recorded path, --smooth {NOISE:g} removes {NOISE:g} mm of noise"
        )
    return chosen


def smoothing_for(scenario: "Scenario") -> float:
    """Return how much noise [mm] to remove from a path whose bends leave little workspace."""
    return NOISE * (scenario.draws.varied_task.template.error_max < NARROW)


def options(
    *,
    scenario: str = "standard",
    pace: str = "medium",
    path: str | None = None,
    machine: str | None = None,
    hand: str | None = None,
    smooth: float = 0.0,
) -> str:
    """Return those of these options that are not usual, as a command line has them."""
    given = {"scenario": scenario, "pace": pace, "path": path, "machine": machine, "hand": hand}
    usual = ("standard", "medium", None)
    shown = {name: value for name, value in given.items() if value not in usual}
    shown |= {"smooth": f"{smooth:g}"} if path and smooth else {}
    return "".join(f" --{name} {quote(value)}" for name, value in shown.items() if value)


def split_numbers(field: str, text: str) -> list[float]:
    """Return numbers that are separated by commas, or raise a ParameterError for the field."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError(f"{field} must be numbers separated by commas, got {text!r}") from None


def check_file(out: Path, suffix: str, field: str = "out") -> None:
    """Raise a ParameterError unless a file with this suffix can be written."""
    if not has_ending(out, suffix):
        raise ParameterError(f"{field} must end in {suffix}, got {str(out)!r}")
    check_target(field, out)
