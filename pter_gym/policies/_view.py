"""How an agent sees worlds and acts in them, whichever interface it uses.

Environments, JAX's worlds and models in an evaluation look through the same ``View``. Its functions
take and return arrays of NumPy, or of JAX.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Self, TypedDict, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._engine.batch import ActionUnit, Observations
from pter_gym._engine.storage import Array, Mask
from pter_gym._internal.checks import whole_number
from pter_gym._internal.fields import check_number
from pter_gym.controllers import Controller, Policy
from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Machine
from pter_gym.policies._base_law import REACH, Actions, BaseLaw, find_base_law
from pter_gym.policies._history import Floats, History, checked_history
from pter_gym.tasks.path_following._actions import volts_of_each

if TYPE_CHECKING:
    import jax

LawMemory = TypeVar("LawMemory", Array, "jax.Array")


class ViewArguments(TypedDict, total=False):
    """Arguments of environments that say how an agent sees and acts: those of ``find_view``."""

    action_unit: ActionUnit
    frame_skip: int | None
    base: str | Controller | None
    reach: float | None
    history: Sequence[int]


@dataclass(frozen=True)
class View:
    """How an agent sees worlds and acts in them.

    Attributes
    ----------
    frame_skip
        Control steps for which an action is held, ≥ 1.
    history
        Control steps ago of what observations end with.
    base, reach
        The control law that actions correct, and by how many volts at most.
    action_unit
        What an action without a base stands for; with one, actions are within [−1, 1].

    Raises
    ------
    ParameterError
        If a value is out of range.
    """

    frame_skip: int = 1
    history: tuple[int, ...] = ()
    base: Controller | None = None
    reach: float | None = None
    action_unit: ActionUnit = "normalised"

    def __post_init__(self) -> None:
        """Check the values."""
        if self.action_unit not in (units := get_args(ActionUnit)):
            raise ParameterError(
                f"action_unit must be one of {', '.join(units)}, got {self.action_unit!r}"
            )
        if self.base is None and self.reach is not None:
            raise ParameterError(f"reach must not be given without a base, got {self.reach!r:.200}")
        if self.base is not None:
            if self.action_unit != "normalised":
                raise ParameterError(
                    "action_unit must be 'normalised' with a base, whose voltages an action "
                    f"corrects, got {self.action_unit!r}"
                )
            check_number("reach", self.reach, above=0.0)
        object.__setattr__(self, "frame_skip", whole_number("frame_skip", self.frame_skip))
        object.__setattr__(self, "history", checked_history(self.history))

    @property
    def looks(self) -> bool:
        """Whether it looks at each control step, also while an action is held."""
        return self.base is not None or bool(self.history)

    @property
    def held_by_worlds(self) -> int:
        """Control steps for which worlds themselves hold what they are given."""
        return 1 if self.looks else self.frame_skip

    @property
    def unit_of_worlds(self) -> ActionUnit:
        """Unit of what worlds are given."""
        return self.action_unit if self.base is None else "volt"

    def bind(self, machine: Machine, layout: Layout) -> "BoundView":
        """Return the view of worlds with a nominal machine and a layout of observations."""
        return BoundView(self, machine, layout)


def find_view(
    whose_gains: str,
    usual_skip: int,
    voltage_max: float,
    *,
    action_unit: ActionUnit = "normalised",
    frame_skip: int | None = None,
    base: str | Controller | None = None,
    reach: float | None = None,
    history: Sequence[int] = (),
) -> View:
    """Return the view that arguments of an environment describe.

    A base by its name has the gains for a scenario, and by default the reach ``REACH`` of the
    machine's largest voltage. Without a base, actions are held for ``usual_skip`` control steps by
    default.
    """
    law = None if base is None else find_base_law(base, whose_gains)
    usual = usual_skip if law is None else 1
    skip = usual if frame_skip is None else frame_skip
    if law is not None and reach is None:
        reach = REACH * voltage_max
    return View(skip, checked_history(history), law, reach, action_unit)


class Memory(NamedTuple, Generic[LawMemory, Floats]):
    """What a view remembers of N worlds.

    Attributes
    ----------
    law
        Memory of the base, float64 (N, M); as words in JAX.
    base
        Its latest voltages [V], float32 (N, 4).
    latest
        The latest observations, float32 (N, steps, entries).
    """

    law: LawMemory
    base: Floats
    latest: Floats


ArrayMemory = Memory[Array, Observations]


class BoundView:
    """A view of worlds with a nominal machine and a layout of observations.

    Attributes
    ----------
    view
        The view.
    base
        The law that actions correct, or None.
    law_digest
        What the base is known by; empty without one.
    layout
        Layout of what is seen: observations, the base's voltages, and earlier ones of both.
    bounds
        Lowest and highest entry of an action.
    """

    def __init__(self, view: View, machine: Machine, layout: Layout) -> None:
        self.view, self.base = view, None
        if view.base is not None and view.reach is not None:
            self.base = BaseLaw(view.base, machine, layout, view.reach)
        self.law_digest = self.base.digest if self.base else ""
        self._history = History(view.history, self.base.layout if self.base else layout)
        self.layout = self._history.layout
        self._top, self._clutches = machine.clutch.voltage_max, len(machine.clutches)
        self.bounds = (0.0, self._top) if view.action_unit == "volt" else (-1.0, 1.0)

    def start(self, worlds: int) -> ArrayMemory:
        """Return the memory of worlds whose episodes begin, before they are looked at."""
        law = np.zeros((worlds, 0)) if self.base is None else self.base.start(worlds)
        latest = np.zeros((worlds, *self._history.shape), np.float32)
        return Memory(law, np.zeros((worlds, SLOTS), np.float32), latest)

    def after(
        self,
        memory: Memory[LawMemory, Floats],
        obs: Floats,
        begins: "Mask | jax.Array",
        act: Callable[[Floats, LawMemory], tuple[Floats, LawMemory]],
    ) -> Memory[LawMemory, Floats]:
        """Return the memory after a look at the worlds' observations, float32 (N, entries).

        In worlds that begin, (N,), all earlier observations equal this one. ``act`` is the base's
        for such arrays: ``self.act``, or that of JAX.
        """
        if self.base is not None:
            base, law = act(obs, memory.law)
            obs, memory = self.base.seen(obs, base), memory._replace(law=law, base=base)
        return memory._replace(latest=self._history.after(memory.latest, obs, begins))

    def act(self, obs: Observations, law: Array) -> tuple[Observations, Array]:
        """Return what the base's ``act`` does."""
        assert self.base is not None
        return self.base.act(obs, law)

    def seen(self, memory: Memory[LawMemory, Floats]) -> Floats:
        """Return what is seen after the latest look, float32 (N, len(layout))."""
        return self._history.seen(memory.latest)

    def given(
        self, actions: Actions, memory: Memory[LawMemory, Floats]
    ) -> tuple[Actions, Memory[LawMemory, Floats]]:
        """Return what actions, (N, clutches), give to worlds in a control step, and the memory.

        It is in ``unit_of_worlds``.
        """
        if self.base is not None:
            actions = self.base.corrected(actions, memory.base)
        return actions, memory

    def volts(self, given: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the voltages [V] of what worlds are given."""
        return given if self.base is not None else volts_of_each(given, *self.bounds, self._top)

    def policy(self, agent: Policy) -> Policy:
        """Return the policy that acts at every control step as an agent behind this view would.

        Parameters
        ----------
        agent
            Its ``act`` maps what is seen to actions, at each ``frame_skip``-th control step.
        """

        def start(worlds: int, episodes: Sequence[int] | None = None) -> Held:
            actions = np.zeros((worlds, self._clutches))
            own = agent.start(worlds, episodes)
            return Held(own, self.start(worlds), actions, np.zeros(worlds, np.intp))

        def act(observations: Observations, memory: Held) -> NDArray[np.floating]:
            decides = memory.age % self.view.frame_skip == 0
            if self.view.looks:
                memory.view = self.after(memory.view, observations, memory.age == 0, self.act)
            if decides.any():
                seen = self.seen(memory.view) if self.view.looks else observations
                actions = agent.checked(agent.act(seen, memory.own), seen, self._clutches)
                memory.actions[decides] = actions[decides]
            memory.age += 1
            given, memory.view = self.given(memory.actions, memory.view)
            return self.volts(given)

        return replace(agent, act=act, start=start, frame_skip=1, any_frame_skip=False, made=None)


@dataclass
class Held:
    """What an agent remembers of N worlds, with its view's memory and the actions that it holds.

    Attributes
    ----------
    own, view
        What the agent remembers, and the view.
    actions
        Latest actions, float64 (N, clutches).
    age
        Control steps since each episode began, (N,).
    """

    own: Any
    view: ArrayMemory
    actions: Array
    age: NDArray[np.intp]

    def __getitem__(self, rows: Mask) -> Self:
        """Return the memory of some worlds."""
        own = None if self.own is None else self.own[rows]
        view = self.view._make(part[rows] for part in self.view)
        return type(self)(own, view, self.actions[rows], self.age[rows])

    def __setitem__(self, rows: Mask, other: Self) -> None:
        """Change the memory of some worlds."""
        if self.own is not None:
            self.own[rows] = other.own
        for part, new in zip(self.view, other.view, strict=True):
            part[rows] = new
        self.actions[rows], self.age[rows] = other.actions, other.age


def at_every_step(policy: Policy, machine: Machine) -> Policy:
    """Return a policy that holds its own voltages, to be called at every control step."""
    if policy.frame_skip == 1:
        return policy
    view = View(frame_skip=policy.frame_skip, action_unit="volt")
    return view.bind(machine, policy.layout).policy(policy)
