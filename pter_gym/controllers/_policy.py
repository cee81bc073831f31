"""Policies: from observations, and what a policy remembers, to clutch voltages.

A *controller* is a frozen set of gains, a trained network, or anything else with ``bind(machine,
layout)``, which returns a policy for a nominal machine and the observations that it will get.
"""

import warnings
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import pairwise
from typing import Any, Protocol, Self, SupportsIndex, get_args, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.addresses import address_of
from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import rows, width
from pter_gym._internal.checks import whole_number
from pter_gym._internal.fields import require
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers._gains import Memory
from pter_gym.controllers._law_kernel import FAULTS, LAW_TYPES, kernel_of, law_error
from pter_gym.errors import ParameterError, PterError
from pter_gym.params import BASELINE, SLOTS, Machine, find_machine
from pter_gym.tasks.path_following._observation import Sensors, observation_layout

Observations = NDArray[np.float32]
Array = NDArray[np.float64]
Volts = NDArray[np.floating]
ScalarLaw = Callable[..., PerClutch]
Rows = tuple[tuple[float, float], ...]


@runtime_checkable
class Controller(Protocol):
    """A control law with its gains, a trained network, or anything else that acts once bound."""

    def bind(self, machine: Machine, layout: Layout) -> "Policy":
        """Return the policy for a nominal machine and the layout of its observations."""
        ...


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """A compiled law for a machine and a layout of observations.

    Attributes
    ----------
    function, gains
        The scalar function, and its gains, float64 (G,).
    parts
        Parts of the gains by name: the first entry, and the one after the last.
    scales
        Scales of the observations, (entries,).
    clutches
        Number of clutches.
    voltage_max
        Their largest voltage [V].
    """

    function: ScalarLaw
    gains: Array
    parts: dict[str, tuple[int, int]]
    scales: Array
    clutches: int
    voltage_max: float

    @cached_property
    def kernel(self) -> Any:
        """The law in many worlds; see ``kernel_of``."""
        return kernel_of(self.function)

    @cached_property
    def address(self) -> int:
        """Where the kernel is."""
        return address_of(self.kernel, LAW_TYPES)

    @contextmanager
    def faults(self, memory: Array) -> Generator[None]:
        """Raise what is wrong in the law as an error of one line."""
        try:
            with np.errstate(all="ignore"):  # where it is not compiled
                yield
        except PterError:
            raise
        except FAULTS as error:
            lengths = len(self.scales), len(self.gains), memory.shape[1]
            raise law_error(self.function, error, *lengths) from error

    def act(self, observations: Observations, memory: Array, released: float = 0.0) -> Volts:
        """Return what ``Policy.act`` does; a clutch that the law releases gets ``released`` [V]."""
        if observations.shape != (len(memory), len(self.scales)):
            raise ParameterError(
                f"observations must have the shape {(len(memory), len(self.scales))}, one for each "
                f"world of the memory, got {observations.shape}"
            )
        volts = np.empty((len(observations), SLOTS))
        with self.faults(memory):
            gains, top = self.gains, self.voltage_max
            self.kernel(observations, self.scales, gains, memory, released, top, volts)
        return volts[:, : self.clutches]


@dataclass(frozen=True, eq=False)
class Policy:
    """What acts in N worlds: ``volts = policy.act(observations, memory)``.

    It changes only the memory, which belongs to the caller, so one policy can act in several places
    at once. ``from_law`` and ``from_function`` make policies.

    Attributes
    ----------
    layout
        Layout of the observations.
    act
        Maps observations, float32 (N, entries) and contiguous, and the memory, which it changes, to
        clutch voltages [V], (N, clutches).
    start
        ``start(worlds, episodes=None)`` returns the memory of N worlds whose episodes begin: an
        array with a row for each, or None. ``episodes`` numbers the episodes, 0 … N − 1 by default;
        a random policy draws different numbers in each.
    frame_skip
        Control steps for which its voltages are held, as in training.
    any_frame_skip
        Whether it may act with any ``frame_skip``, as control laws may.
    law
        The compiled law, if it is one.
    name
        Its name in errors and warnings.
    control_period
        The only control period at which it may act [s]; None for any.
    made
        Recreates it in another process, for ``pickle``.
    machine
        The nominal machine that it is bound to, if it depends on one.
    """

    layout: Layout
    act: Callable[[Observations, Any], Volts]
    start: Callable[..., Any]
    frame_skip: int = 1
    any_frame_skip: bool = True
    law: CompiledLaw | None = None
    name: str = "policy"
    control_period: float | None = None
    made: "Callable[[], Policy] | None" = None
    machine: Machine | None = None

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """Return how it is made, since what acts cannot be pickled."""
        return (self.made, ()) if self.made else super().__reduce_ex__(protocol)

    def __deepcopy__(self, memo: object) -> Self:
        """Return itself, which nothing changes."""
        return self

    def check_period(self, period: float) -> None:
        """Raise a ParameterError unless it may act at a control period [s]."""
        if self.control_period not in (None, period):
            raise ParameterError(
                f"control_period must be that of the policy, {self.control_period:g} s, "
                f"got {period:g}"
            )

    def volts(self, observations: Observations, memory: Any, machine: Machine) -> Volts:
        """Return the voltages of ``act`` within the range of a machine's drive, (N, clutches).

        Voltages beyond the range are clipped, as by a drive, with one warning.

        Raises
        ------
        ParameterError
            If it returns anything but a row of voltages for each world.
        """
        volts = self.act(observations, memory)
        if self.law:  # is within the range
            return volts
        top = machine.clutch.voltage_max
        volts = self.checked(volts, observations, len(machine.clutches))
        slack = 4.0 * float(np.spacing(np.float32(top)))  # what float32 rounds
        if ((volts < -slack) | (volts > top + slack)).any():
            warnings.warn(
                f"{self.name} gives voltages beyond [0, {top:g}] V, which are clipped", stacklevel=1
            )
        return volts.clip(0.0, top)

    def checked(self, values: Any, observations: Observations, clutches: int) -> NDArray[Any]:
        """Return what ``act`` has returned as an array, a number for each world and clutch.

        Raises
        ------
        ParameterError
            If it is anything else.
        """
        try:
            values = np.asarray(values)
            problem = (
                f"shape {values.shape}" if values.dtype.kind in "fiu" else f"dtype {values.dtype}"
            )
        except (ValueError, TypeError, RuntimeError) as error:  # ragged, or a tensor elsewhere
            values, problem = np.empty(0), f"no array ({error})"
        if values.shape != (len(observations), clutches) or values.dtype.kind not in "fiu":
            raise ParameterError(
                f"{self.name} returned {problem} for observations {observations.shape}: "
                f"return one row of {clutches} volts per row"
            )
        return values

    @classmethod
    def from_law(
        cls,
        function: ScalarLaw,
        gains: ArrayLike | Mapping[str, ArrayLike],
        machine: Machine,
        layout: Layout,
        *,
        memory: type[Any] = Memory,
        more_memory: int = 0,
        frame_skip: int | None = None,
        control_period: float | None = None,
    ) -> "Policy":
        """Return the policy of a compiled law.

        Parameters
        ----------
        function
            ``law(obs, scales, gains, memory) -> PerClutch``, a function of one world that
            ``pter_gym.controllers.compiled`` compiles. ``obs·scales`` is in physical units.
            Voltages beyond the machine's range are clipped.
        gains
            Numbers that the law reads, (G,), or their parts by name, in order; in C code, each part
            that the law looks up is an array.
        machine, layout
            The nominal machine, and the layout of the observations.
        memory
            Record of what the law remembers of a world, a ``NamedTuple`` of floats. All are zero
            when an episode begins, except an entry ``episode``, which is the episode's number.
        more_memory
            Numbers that follow this record.
        frame_skip
            Control steps for which the voltages are held; by default, any number will do.
        control_period
            The only control period at which it may act [s]; any by default.
        """
        arrays = gains if isinstance(gains, Mapping) else {"gains": gains}
        ends = np.cumsum([np.size(part) for part in arrays.values()]).tolist()
        parts = dict(zip(arrays, pairwise([0, *ends]), strict=True))
        entries = width(memory) + more_memory
        law = CompiledLaw(
            function,
            np.concatenate([*arrays.values()], dtype=np.float64),
            parts,
            np.array(layout.scales),
            len(machine.clutches),
            machine.clutch.voltage_max,
        )

        def start(worlds: int, episodes: Sequence[int] | None = None) -> NDArray[np.float64]:
            rows_of_worlds = np.zeros((worlds, entries))
            if "episode" in memory._fields:
                number = rows(memory).episode
                rows_of_worlds[:, number] = range(worlds) if episodes is None else episodes
            return rows_of_worlds

        return cls(
            layout,
            law.act,
            start,
            1 if frame_skip is None else whole_number("frame_skip", frame_skip),
            frame_skip is None,
            law,
            control_period=control_period,
            machine=machine,
            made=partial(
                cls.from_law,
                function,
                gains,
                machine,
                layout,
                memory=memory,
                more_memory=more_memory,
                frame_skip=frame_skip,
                control_period=control_period,
            ),
        )

    @classmethod
    def from_function(
        cls,
        function: Callable[..., Any],
        layout: Layout,
        *,
        start: Callable[[int], Any] | None = None,
        frame_skip: int | None = None,
    ) -> "Policy":
        """Return the policy of a Python function.

        Parameters
        ----------
        function
            Maps observations, float32 (N, entries), to voltages [V], (N, clutches); with ``start``,
            observations and memory.
        layout
            Layout of the observations.
        start
            Returns the memory of N worlds at the start of their episodes, an array with a row
            for each; the function changes it in place.
        frame_skip
            Control steps for which the voltages are held; by default, any number will do.
        """

        def act(observations: Observations, memory: Any) -> Volts:
            copied = observations.copy()  # which the function may keep or change
            try:
                return function(copied) if start is None else function(copied, memory)
            except PterError:
                raise
            except (ValueError, TypeError, LookupError) as error:
                raise ParameterError(
                    f"{name} failed for observations {observations.shape}, a row for each world: "
                    f"{type(error).__name__}: {error}"
                ) from error

        def begin(worlds: int, episodes: object = None) -> Any:  # noqa: ARG001
            return None if start is None else start(worlds)

        name: str = getattr(function, "__name__", type(function).__name__)
        skip = 1 if frame_skip is None else whole_number("frame_skip", frame_skip)
        made = partial(cls.from_function, function, layout, start=start, frame_skip=frame_skip)
        return cls(layout, act, begin, skip, frame_skip is None, name=name, made=made)


AnyPolicy = Controller | Policy | Callable[[Observations], Any]
"""What ``bind`` takes: a controller, a policy, or a function from observations to volts."""


def bind(policy: AnyPolicy, machine: Machine | str | None, layout: Layout) -> Policy:
    """Return a policy that is ready to act.

    Parameters
    ----------
    policy
        A controller, a policy, or a function from observations, float32 (N, entries), to volts, (N,
        clutches), which may have a ``frame_skip``.
    machine
        The nominal machine or its name; None for the default PTER.
    layout
        Layout of the observations.

    Raises
    ------
    ParameterError
        If it is none of these, it cannot be bound to this machine and layout or is bound to others,
        or it has a ``reset`` method: what it remembers must be a memory that ``start`` returns.
    """
    if isinstance(policy, Controller):
        policy = policy.bind(find_machine(machine), layout)
    if isinstance(policy, Policy):
        check_same(policy.layout.names, policy.machine, find_machine(machine), layout)
        return policy
    if not callable(policy):
        raise ParameterError(f"policy must have a method bind or be callable, got {policy!r:.200}")
    if hasattr(policy, "reset"):
        raise ParameterError(
            "policy must not keep a memory of its own: "
            "Policy.from_function(act, layout, start=…) makes a "
            f"policy with a memory, got {policy!r:.200} with a method reset"
        )
    return Policy.from_function(policy, layout, frame_skip=getattr(policy, "frame_skip", None))


def check_same(
    names: tuple[str, ...], known: Machine | None, machine: Machine, layout: Layout
) -> None:
    """Raise a ParameterError unless a policy may act with a machine and a layout.

    Parameters
    ----------
    names, known
        Entries of the observations and the machine that it is made for; None for any machine.
    machine, layout
        The nominal machine and the layout of observations with which it is to act.
    """
    if layout.names != names:
        raise ParameterError(
            f"observations must have the {len(names)} entries of the policy, {', '.join(names)}, "
            f"got {', '.join(layout.names)}"
        )
    if known is not None:
        check_drive(machine, clutch_rows(known), known.clutch.voltage_max)


def check_drive(machine: Machine, clutches: Rows, voltage_max: float) -> None:
    """Raise a ParameterError unless a machine has a policy's clutches and largest voltage [V]."""
    check_rows(machine, clutches)
    top = machine.clutch.voltage_max
    accepted = f"{voltage_max:g} V, for which the policy is made"
    require(top == voltage_max, machine.clutch, "voltage_max", accepted, got=top)


def check_rows(machine: Machine, clutches: Rows) -> None:
    """Raise a ParameterError unless a machine has a policy's clutches."""
    rows = clutch_rows(machine)
    accepted = f"{clutches}, for which the policy is made"
    require(rows == clutches, machine, "clutches", accepted, got=rows)


def clutch_rows(machine: Machine) -> Rows:
    """Return the rows of W of a machine's clutches."""
    return tuple(clutch.row for clutch in machine.clutches)


@runtime_checkable
class NeedsSensors(Protocol):
    """What says which sensors it needs."""

    sensors: Sensors


def sensors_of(policy: AnyPolicy) -> Sensors:
    """Return the sensors in a policy's ``sensors`` or layout, by default torque sensors."""
    if isinstance(policy, NeedsSensors):
        return policy.sensors
    names = policy.layout.names if isinstance(policy, Policy) else ()
    return next((each for each in get_args(Sensors) if names_of(each) == names), "torque")


@cache
def names_of(sensors: Sensors) -> tuple[str, ...]:
    """Return the entries of observations with some sensors."""
    return observation_layout(BASELINE, sensors).names
