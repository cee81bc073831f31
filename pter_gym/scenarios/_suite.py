"""The suite: named and versioned scenarios, each a randomisation of machine and task at a commanded
pace.

``PTER/<Scenario>-v0`` is ``PTER/PathFollowing-v0`` on a scenario's training draws. The episodes on
which policies are compared are stored data; see ``pter_gym.benchmark``.

To add a scenario, add an entry to ``_SUITE`` here and to ``VARIED`` in ``_variations``: its id, its
stored episodes and their strata follow from these. This module imports nothing heavy, since
``import pter_gym`` reads it.
"""

import hashlib
from dataclasses import dataclass, fields, replace
from pathlib import PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from pter_gym._internal.checks import is_finite
from pter_gym.errors import ParameterError, unknown_name

if TYPE_CHECKING:
    from pter_gym.params import Machine
    from pter_gym.paths import Path
    from pter_gym.scenarios._fixed_machine import AnyMachine, FixedMachine
    from pter_gym.scenarios.randomisation import Randomisation, Vary
    from pter_gym.tasks.path_following import PathFollowing

PACES = MappingProxyType({"slow": 0.12, "medium": 0.25, "brisk": 0.5})
"""Commanded mean speeds along the path [m/s] at which each scenario is scored."""


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
        Number of its stored evaluation episodes.
    stratum
        The part of the task whose kind defines an evaluation episode's stratum.
    place
        Number from which the seed of its evaluation episodes is derived; by default, the seed is
        derived from name and version.
    fixed_machine
        The machine in place of those that it would draw, if any; see ``find_scenario``.
    varied
        Machine and task of a user-defined scenario, or their distributions; by default those of the
        suite's scenario of this name.
    gains
        The scenario whose gains control laws have, by default this one.
    """

    name: str
    version: int
    asks: str
    episodes: int
    stratum: Literal["path", "hand"] = "path"
    place: int | None = None
    fixed_machine: "FixedMachine | None" = None
    varied: "tuple[Machine | Vary[Machine], Vary[PathFollowing]] | None" = None
    gains: str = ""

    @property
    def whose_gains(self) -> str:
        """The name under which control laws have gains."""
        return self.gains or self.name

    def gains_on(self, path: object) -> str:
        """Return that name where all episodes have a path of the user's, or the scenario's paths if it is None."""
        return "paths" if path is not None and self.name == "standard" else self.whose_gains

    @property
    def nominal(self) -> "Machine":
        """The machine that controllers are bound to: that of all episodes if they share one, otherwise the paper's."""
        from pter_gym.params import BASELINE, Machine

        if self.fixed_machine:
            return self.fixed_machine.machine
        return self.machine if isinstance(self.machine, Machine) else BASELINE

    @property
    def digest(self) -> str:
        """Digest of what it draws; empty for a scenario of the suite, which its name and version tell."""
        if self.fixed_machine is None and self.varied is None:
            return ""
        drawn = (self.fixed_machine, *(self.varied or (self.task,)))
        return hashlib.sha256(repr(drawn).encode()).hexdigest()[:16]

    @property
    def id(self) -> str:
        """The id of the environment."""
        return f"PTER/{self.name.capitalize()}-v{self.version}"

    @property
    def machine(self) -> "Machine | Vary[Machine]":
        """What varies of the machine."""
        from pter_gym.scenarios._variations import VARIED

        return (self.varied or VARIED[self.name])[0]

    @property
    def task(self) -> "Vary[PathFollowing]":
        """What varies of the task."""
        from pter_gym.scenarios._variations import VARIED

        return (self.varied or VARIED[self.name])[1]

    def randomisation(
        self,
        pace: float | str | None = None,
        *,
        contexts: int = 512,
        seed: int = 0,
        **overrides: Any,
    ) -> "Randomisation":
        """Return the training draws.

        Parameters
        ----------
        pace
            Commanded pace [m/s] or its name in ``PACES``; None draws it between the slowest and the
            fastest.
        contexts, seed
            Number of pairs of machine and task, and the seed of their list.
        **overrides
            Fields of the task that all episodes share, such as ``reward``, ``error_max`` and
            ``starts``.

        Raises
        ------
        ParameterError
            If the task has no such field, the scenario draws it, or its value is out of range.
        """
        from pter_gym.scenarios.randomisation import LogUniform, Randomisation, Vary

        commanded = (
            LogUniform(min(PACES.values()), max(PACES.values()))
            if pace is None
            else find_pace(pace)
        )
        base, drawn = self.task.base, self.task.fields
        known = [item.name for item in fields(base) if item.name not in (*drawn, "pace")]
        for name in overrides:
            if name not in known:
                raise ParameterError(
                    f"{name} must be one of what all episodes of {self.name} share: {', '.join(known)}"
                )
        task = Vary(replace(base, **overrides), **drawn, pace=commanded)
        fixed = self.fixed_machine
        return Randomisation(
            machine=self.machine, task=task, contexts=contexts, seed=seed, fixed_machine=fixed
        )


def find_pace(pace: float | str, field: str = "pace") -> float:
    """Return a commanded pace [m/s] given as itself, also in text, or by its name in ``PACES``.

    Raises
    ------
    ParameterError
        If there is no such pace; the message names the field and suggests the nearest name.
    """
    speed: Any = pace
    if isinstance(pace, str):
        if pace in PACES:
            return PACES[pace]
        try:
            speed = float(pace)
        except ValueError:
            raise unknown_name(field, pace, (*PACES, "a speed > 0 m/s")) from None
    if not is_finite(speed) or speed <= 0.0:
        raise ParameterError(
            f"{field} must be one of {', '.join(PACES)}, or a speed > 0 m/s, got {pace!r}"
        )
    return float(speed)


def name_of_pace(pace: float | str, field: str = "pace") -> str:
    """Return the name of a commanded pace, or its speed as text where it has none; raises as ``find_pace``."""
    speed = find_pace(pace, field)
    return next((name for name, named in PACES.items() if named == speed), str(speed))


def title_of_pace(pace: str) -> str:
    """Return a commanded pace as tables show it: ``medium (0.25 m/s)``, or ``0.3 m/s`` for one without a name."""
    speed = f"{find_pace(pace):g} m/s"
    return f"{pace} ({speed})" if pace in PACES else speed


def find_scenario(
    name: "str | PathFollowing | Scenario",
    machine: "AnyMachine | None" = None,
    path: "Path | str | None" = None,
) -> Scenario:
    """Return a scenario by its name.

    Parameters
    ----------
    name
        Its name, or itself. Or a task: its episodes, 200, differ in the phases of its hand's sines.
    machine
        A machine for all its episodes, in place of those that it draws: the machine, its name in
        ``pter_gym.params.MACHINES``, or the path of a preset, whose delay applies to all
        observations. Paths and hands are drawn as usual.
    path
        A path for all its episodes: the path, its name in ``pter_gym.paths.PATHS``, or a CSV file
        of waypoints. The workspace about it is at most as wide as its bends allow.

    Raises
    ------
    ParameterError
        If there is no such scenario, machine or path (the nearest is suggested), a preset's delay
        is too long for a task, or the arm cannot follow the path.
    DataError
        If a preset is malformed.
    """
    found = _find(name)
    if path is not None:
        found = _on_path(found, path)
    if machine is not None:
        from pter_gym.scenarios._fixed_machine import find_fixed_machine, with_delay

        fixed = find_fixed_machine(machine)
        found = replace(found, fixed_machine=fixed)
        with_delay(found.task.base, fixed)  # raises where the delay is too long
    return found


def _find(name: Any) -> Scenario:
    if isinstance(name, Scenario):
        return name
    if isinstance(name, str) and name in SCENARIOS:
        return SCENARIOS[name]
    from pter_gym.tasks.path_following import PathFollowing

    if not isinstance(name, PathFollowing):
        raise unknown_name("scenario", name, SCENARIOS)
    from pter_gym.hands import MultiSineHand
    from pter_gym.params import BASELINE
    from pter_gym.scenarios.randomisation import Vary

    hand: Any = name.hand
    task = (
        replace(name, hand=replace(hand, random_phases=True))
        if hasattr(hand, "random_phases")
        else name
    )
    gains = "paths" if isinstance(name.hand, MultiSineHand) else "everything"
    called = type(name.path).__name__.lower()
    return Scenario(
        called, 0, "A task of your own.", episodes=200, varied=(BASELINE, Vary(task)), gains=gains
    )


def _on_path(scenario: Scenario, given: "Path | str") -> Scenario:
    """Return a scenario with one path for all episodes."""
    from pter_gym.paths import find_path
    from pter_gym.scenarios.randomisation import Vary
    from pter_gym.tasks.path_following._specification import check_machine, largest_error_max

    path = find_path(given)
    called = PurePath(given).stem if isinstance(given, str) else type(path).__name__.lower()
    base, band = (
        scenario.task.base,
        max(scenario.task.base.free_left, scenario.task.base.free_right),
    )
    widest = largest_error_max(path) - band
    if widest <= 0.0:
        raise ParameterError(
            f"path must bend less for a free band of {band:g} m: {called} turns within that radius"
        )
    task = replace(base, path=path, error_max=min(base.error_max, widest))
    check_machine(task, scenario.nominal)
    varied = {name: drawn for name, drawn in scenario.task.fields.items() if name != "path"}
    drawn = (scenario.machine, Vary(task, **varied))
    gains = scenario.gains_on(path)
    return replace(
        scenario, name=f"{scenario.name}-on-{called}", place=None, varied=drawn, gains=gains
    )


_SUITE = (
    Scenario(
        "standard",
        0,
        "The paper's line, hand and clutches; the phases of the disturbance differ.",
        episodes=200,
        place=0,
    ),
    Scenario(
        "paths",
        0,
        "Other paths, most of them curved; the paper's hand and clutches.",
        episodes=300,
        place=1,
    ),
    Scenario(
        "hands",
        0,
        "Other hands on the paper's line: forces of any spectrum, and human arms with mass, damper and spring.",
        episodes=300,
        stratum="hand",
        place=2,
    ),
    Scenario(
        "materials",
        0,
        "Other clutches on the paper's line: material, time constant, torque errors and drift.",
        episodes=300,
        place=3,
    ),
    Scenario(
        "everything",
        0,
        "Paths, hands and clutches as in the other scenarios, other inertias, and sensors with noise and delay.",
        episodes=1000,
        place=4,
    ),
    Scenario(
        "tremor",
        0,
        "Human arms from relaxed to stiff, on the paper's line, with physiological, essential or Parkinsonian tremor.",
        episodes=300,
        stratum="hand",
    ),
    Scenario(
        "corridor",
        0,
        "A corridor 40 mm wide about the paper's line: the tip is free within it and guided at its edges.",
        episodes=200,
    ),
    Scenario(
        "wall",
        0,
        "A wall along the paper's line, on which the hand leans: the tip is free on one side and must not get beyond.",
        episodes=200,
        stratum="hand",
    ),
)

SCENARIOS = MappingProxyType({each.name: each for each in _SUITE})
"""The scenarios by name."""
