"""The suite: named and versioned scenarios, each with its draws of machine and task.

``PTER/<Scenario>-v0`` is ``PTER/PathFollowing-v0`` on a scenario's training episodes. Test episodes
are stored data; see ``pter_gym.benchmark``.

To add a scenario, add an entry to ``_SUITE`` here and to ``SUITE_DRAWS`` in ``variations``: its
id, its stored episodes and their strata follow from these. This module imports nothing heavy, since
``import pter_gym`` reads it.
"""

import hashlib
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from pter_gym.errors import ParameterError, unknown_name

if TYPE_CHECKING:
    from pter_gym._internal.files import FilePath
    from pter_gym.hands import HandSpread, Operator
    from pter_gym.params import Machine, MachineSpread
    from pter_gym.paths import Path
    from pter_gym.scenarios.distributions import Draws
    from pter_gym.tasks.path_following import PathFollowing


YOUNGER: Mapping[str, object] = {"failures": (), "hysteresis": 0.0}
"""Fields that are younger than digests, which leave them out where they have these defaults."""


@dataclass(frozen=True)
class Scenario:
    """A named set of episodes.

    Attributes
    ----------
    name, version
        Name and version, as in the id ``PTER/<Name>-v<version>``.
    asks
        What it requires of a policy, in one sentence.
    episodes
        Number of its test episodes.
    stratum
        The part of the task whose kind defines a test episode's stratum.
    place
        Number from which the seed of its test episodes is derived; by default, the seed is
        derived from name and version.
    own
        Its own draws; by default those of the suite's scenario of this name.
    gains
        The scenario whose gains control laws have, by default this one.
    residual
        Mean return of the trained policy ``residual``, acting at each control step, in 256
        training episodes as the id draws them; its standard error is below 2.
    """

    name: str
    version: int
    asks: str
    episodes: int
    stratum: Literal["path", "hand"] = "path"
    place: int | None = None
    own: "Draws | None" = None
    gains: str = ""
    residual: float | None = None

    @property
    def whose_gains(self) -> str:
        """Name of the scenario whose gains control laws use."""
        return self.gains or self.name

    @property
    def draws(self) -> "Draws":
        """What its training and test episodes are drawn from."""
        from pter_gym.scenarios.variations import SUITE_DRAWS

        return SUITE_DRAWS[self.name] if self.own is None else self.own

    @property
    def nominal(self) -> "Machine":
        """The machine that laws are bound to, the middle of its draws."""
        return self.draws.middle

    @property
    def digest(self) -> str:
        """Digest of its own draws; empty for a scenario of the suite.

        Raises
        ------
        ParameterError
            If they hold an object without a repr of its own, by which other processes could
            identify it.
        """
        draws = repr(self.own)
        for name, default in YOUNGER.items():
            draws = re.sub(rf", {name}={re.escape(repr(default))}(?=[,)])", "", draws)
        if unknown := re.search(r"<?(\S+)(?: object)? at 0x", draws):
            raise ParameterError(
                f"scenario must be identified by its repr: make {unknown[1]} a frozen dataclass"
            )
        return hashlib.sha256(draws.encode()).hexdigest()[:16] if self.own else ""

    @property
    def id(self) -> str:
        """The id of the environment."""
        return f"PTER/{self.name.capitalize()}-v{self.version}"

    @property
    def reward_threshold(self) -> float | None:
        """Mean return of training episodes from which the id counts as solved.

        90 % of what ``residual`` earns, and more than any control law does. Episodes begin anywhere
        along the path, so few can earn the 100 of a whole one.
        """
        return None if self.residual is None else round(0.9 * self.residual, 1)


def find_scenario(
    scenario: "str | Scenario | Draws | PathFollowing",
    machine: "Machine | MachineSpread | FilePath | None" = None,
    path: "Path | FilePath | None" = None,
    smooth: float = 0.0,
    hand: "Operator | HandSpread | str | None" = None,
) -> Scenario:
    """Return a scenario by its name.

    Parameters
    ----------
    scenario
        A scenario or its name. Draws, or a task, whose episodes differ in the phases of its hand's
        sines, become a scenario of 200 episodes.
    machine
        A machine for all its episodes, instead of drawn ones: the machine, its name in
        ``pter_gym.params.MACHINES``, or its file. Or a ``MachineSpread``, as ``find_machines``
        returns it. Paths and hands are drawn as usual.
    path
        A path for all its episodes: the path, its name in ``pter_gym.paths.PATHS``, or a CSV file
        of waypoints. The workspace about it is at most as wide as its bends allow.
    smooth
        How far a path from a file may deviate from its waypoints [m], see
        ``pter_gym.paths.Spline``.
    hand
        A hand for all its episodes, or its name or file as ``pter_gym.hands.find_hands`` takes it:
        of a measured hand, each episode draws one that fits the log. The phases of its sines differ
        between episodes.

    Raises
    ------
    ParameterError
        If there is no such scenario, machine, path or hand (the nearest is suggested), a machine's
        delay is too long for a task, or the arm cannot follow the path.
    DataError
        If the machine's file is malformed.
    """
    scenario = _find(scenario, machine)
    scenario = scenario if path is None else _on_path(scenario, path, smooth)
    return scenario if hand is None else _with_hand(scenario, hand)


def gains_for(tasks: "Iterable[PathFollowing]") -> str:
    """Return the name of the scenario whose gains suit a user's tasks."""
    from pter_gym.tasks.path_following import PathFollowing

    tasks = [*tasks]
    pushes = not any(task.hand.plans for task in tasks)
    if all(task.path == PathFollowing.path for task in tasks):
        return "standard" if pushes else "hands"
    return "paths" if pushes else "everything"


def _find(
    scenario: "str | Scenario | Draws | PathFollowing",
    machine: "Machine | MachineSpread | FilePath | None",
) -> Scenario:
    """Return a scenario with a machine for all its episodes, if there is one."""
    if isinstance(scenario, str) and scenario in SCENARIOS:
        scenario = SCENARIOS[scenario]
    if not isinstance(scenario, Scenario):
        from pter_gym.scenarios.distributions import Draws
        from pter_gym.tasks.path_following import PathFollowing

        if isinstance(scenario, Draws):
            own = scenario if machine is None else _on_machine(scenario, machine)
            gains = gains_for(task for _, task in own.pairs(8))
            return Scenario("own", 0, "Draws of your own.", episodes=200, own=own, gains=gains)
        if not isinstance(scenario, PathFollowing):
            raise unknown_name("scenario", scenario, SCENARIOS)
        name, gains = type(scenario.path).__name__.lower(), gains_for([scenario])
        own = Draws(task=replace(scenario, hand=_disturbing(scenario.hand)))
        scenario = Scenario(name, 0, "A task of your own.", episodes=200, own=own, gains=gains)
    if machine is None:
        return scenario
    return replace(scenario, own=_on_machine(scenario.draws, machine))


def _on_machine(draws: "Draws", machine: "Machine | MachineSpread | FilePath") -> "Draws":
    """Return draws with a machine in place of drawn ones."""
    from pter_gym.params import MachineSpread, find_machine
    from pter_gym.tasks.path_following._specification import sensing_of

    own = machine if isinstance(machine, MachineSpread) else find_machine(machine)
    changed = draws.map_components(lambda one: replace(one, instead=own))
    sensing_of(draws.varied_task.template, changed.middle)  # raises where the delay is too long
    return changed


def _on_path(scenario: Scenario, source: "Path | FilePath", smooth: float) -> Scenario:
    """Return a scenario with one path for all episodes."""
    from pter_gym.paths import find_path, read_path
    from pter_gym.scenarios.distributions import Vary
    from pter_gym.tasks.path_following._specification import check_machine, largest_error_max

    is_name = isinstance(source, str | os.PathLike)
    path = read_path(source, smooth=smooth) if smooth and is_name else find_path(source)
    title = PurePath(source).stem if is_name else type(path).__name__.lower()
    title += f"-smooth-{1e3 * smooth:g}-mm" if smooth else ""

    def changed(draws: "Draws") -> "Draws":
        template, fields = draws.varied_task.template, dict(draws.varied_task.fields)
        fields.pop("path", None)
        band = max(template.free_left, template.free_right)
        widest = largest_error_max(path) - band
        if widest <= 0.0:
            raise ParameterError(
                f"path must bend less for a free band of {band:g} m: {title} turns within that "
                "radius"
            )
        task = replace(template, path=path, error_max=min(template.error_max, widest))
        check_machine(task, draws.middle)
        return replace(draws, task=Vary(task, **fields))

    gains = "paths" if scenario.whose_gains == "standard" else scenario.whose_gains
    return replace(
        scenario,
        name=f"{scenario.name}-on-{title}",
        place=None,
        own=scenario.draws.map_components(changed),
        gains=gains,
    )


def _disturbing(hand: "Operator") -> Any:
    """Return a hand whose sines have other phases in each episode."""
    known: Any = hand
    return replace(known, random_phases=True) if known.phases else known


def _with_hand(scenario: Scenario, source: "Operator | HandSpread | str") -> Scenario:
    """Return a scenario with one hand for all episodes, or with draws of a measured one."""
    from pter_gym.hands import HandSpread, find_hands
    from pter_gym.scenarios.distributions import Vary

    found, drawn = find_hands(source), {}
    hand = _disturbing(found.hand if isinstance(found, HandSpread) else found)
    if isinstance(found, HandSpread):
        drawn = {"hand": replace(found, hand=hand)}
    title = PurePath(source).stem if isinstance(source, str) else type(hand).__name__.lower()

    def changed(draws: "Draws") -> "Draws":
        varied = draws.varied_task
        fields = {name: each for name, each in varied.fields.items() if name != "hand"} | drawn
        return replace(draws, task=Vary(replace(varied.template, hand=hand), **fields))

    gains = scenario.whose_gains
    return replace(
        scenario,
        name=f"{scenario.name}-by-{title}",
        place=None,
        own=scenario.draws.map_components(changed),
        gains=_GAINS_FOR_ARMS.get(gains, gains) if hand.plans else gains,
    )


_GAINS_FOR_ARMS = {"standard": "hands", "paths": "everything"}
"""In place of a scenario whose hands only push: the one whose gains suit others."""

_SUITE = (
    Scenario(
        "standard",
        0,
        "The paper's line, hand and clutches; the phases of the disturbance differ.",
        episodes=200,
        place=0,
        residual=63.0,
    ),
    Scenario(
        "paths",
        0,
        "Other paths, most of them curved; the paper's hand and clutches.",
        episodes=300,
        place=1,
        residual=62.0,
    ),
    Scenario(
        "hands",
        0,
        "Other hands on the paper's line: forces of any spectrum, and human arms with mass, damper "
        "and spring.",
        episodes=300,
        stratum="hand",
        place=2,
        residual=60.1,
    ),
    Scenario(
        "materials",
        0,
        "Other clutches on the paper's line: material, time constant, torque, friction drift.",
        episodes=300,
        place=3,
        residual=60.4,
    ),
    Scenario(
        "everything",
        0,
        "Paths, hands and clutches as in the other scenarios, other inertias, and sensors with "
        "noise and delay.",
        episodes=1000,
        place=4,
        residual=49.1,
    ),
    Scenario(
        "tremor",
        0,
        "Human arms from relaxed to stiff, on the paper's line, with physiological, essential or "
        "Parkinsonian tremor.",
        episodes=300,
        stratum="hand",
        residual=52.4,
    ),
    Scenario(
        "corridor",
        0,
        "A corridor 40 mm wide about the paper's line: the tip is free within it and guided at its "
        "edges.",
        episodes=200,
        residual=65.1,
    ),
    Scenario(
        "wall",
        0,
        "A wall along the paper's line, on which the hand leans: the tip is free on one side and "
        "must not cross it.",
        episodes=200,
        stratum="hand",
        residual=63.0,
    ),
)

SCENARIOS = MappingProxyType({scenario.name: scenario for scenario in _SUITE})
"""The scenarios by name."""
