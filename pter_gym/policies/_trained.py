"""A trained policy: its interface and its weights."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import flat
from pter_gym._internal.fields import require
from pter_gym.controllers import Policy, Scaled
from pter_gym.controllers._network import LAW_WIDTH, Network, memory_width, network_on, source_of
from pter_gym.controllers._policy import CompiledLaw, check_rows, clutch_rows
from pter_gym.errors import DataError, unknown_name
from pter_gym.params import SLOTS, Machine, find_machine
from pter_gym.policies._interface import Interface, input_names

MAX_UNITS, MAX_LAYERS = 1024, 8
"""Largest numbers of units in a hidden layer, and of layers."""

Weights = NDArray[np.float32]


def are_hidden(sizes: object) -> bool:
    """Return whether a policy may have hidden layers with these numbers of units."""
    return (
        isinstance(sizes, tuple)
        and len(units := cast("tuple[object, ...]", sizes)) < MAX_LAYERS
        and all(type(each) is int and 1 <= each <= MAX_UNITS for each in units)
    )


@dataclass(frozen=True, eq=False)
class TrainedController:
    """A trained network; like a law, it is bound to become a policy.

    Attributes
    ----------
    interface
        Inputs and outputs of its network.
    layers
        Weights, float32 (outputs, inputs), and biases, float32 (outputs,), of each layer; tanh
        follows all but the last.
    name
        Its name.
    about
        Scenario, training command, versions, scores: for people; they do not affect how the policy
        acts.

    Raises
    ------
    DataError
        If the layers do not fit each other or the interface, or hold numbers that are not finite.
    """

    interface: Interface
    layers: tuple[tuple[Weights, Weights], ...]
    name: str = "policy"
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        """Check the layers."""
        sizes = self.sizes
        outputs = len(self.interface.clutches)
        if not self.layers or not are_hidden(sizes[1:-1]) or sizes[-1] != outputs:
            raise DataError(
                f"layers must be 1 to {MAX_LAYERS} of at most {MAX_UNITS} units that end in "
                f"{outputs}, got {sizes}"
            )
        for k, ((weight, bias), (before, after)) in enumerate(
            zip(self.layers, pairwise(sizes), strict=True)
        ):
            for name, array, shape in (
                ("weight", weight, (after, before)),
                ("bias", bias, (after,)),
            ):
                if (
                    array.dtype != np.float32
                    or array.shape != shape
                    or not np.isfinite(array).all()
                ):
                    raise DataError(
                        f"layer_{k}.{name} must be finite float32 {shape}, "
                        f"got {array.dtype} {array.shape}"
                    )

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of inputs, and of the units of each layer."""
        return (self.interface.size, *(bias.size for _, bias in self.layers))

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine and the layout of its observations.

        Raises
        ------
        ParameterError
            If the observations lack an input, or the machine's W differs from that in training.
        """
        machine = find_machine(machine)
        own = self.for_machine(machine)
        if own is not self:
            return own.bind(machine, layout)
        interface = self.interface
        names = input_names(layout, residual=interface.base is not None)
        for entry in interface.inputs:
            if entry.name not in names:
                raise unknown_name("inputs", entry.name, names)
        base = interface.base.bind(machine, layout).law if interface.base else None
        gains, network = self._gains(base, layout)
        policy = Policy.from_law(
            network_on(base.function if base else None),
            gains,
            machine,
            layout,
            more_memory=memory_width(network) - LAW_WIDTH,
            frame_skip=interface.frame_skip,
            control_period=interface.control_period,
        )
        return replace(policy, made=partial(self.bind, machine, layout))

    def for_machine(self, machine: Machine) -> "TrainedController":
        """Return the policy specialised for one machine; itself, if it is made for this one.

        Voltages are fractions of the largest. What a policy for any machine observes of a clutch
        that the machine lacks is constant and becomes part of the first biases. A warning names
        traits outside the training's ranges.

        Raises
        ------
        ParameterError
            If the machine has no clutch, or others than those of the training.
        """
        interface = self.interface
        rows, top = clutch_rows(machine), machine.clutch.voltage_max
        if interface.for_any_machine:
            fits = len({*rows}) == len(rows) and {*rows} <= {*interface.clutches}
            require(fits, machine, "clutches", f"some of {interface.clutches}", got=rows)
        else:
            check_rows(machine, interface.clutches)
            if top == interface.voltage_max:
                return self
        if beyond := interface.beyond_training(machine):
            text = f"{self.name} was not trained on such a machine: {'; '.join(beyond)}"
            warnings.warn(text, stacklevel=2)
        inputs = [each.on(machine, interface) for each in interface.inputs]
        (weight, bias), *others = self.layers
        columns: list[int] = []
        first = bias.astype(np.float64)
        for k in range(interface.size):  # in one order on all computers
            each = k % len(inputs)
            if inputs[each] is None:
                first += weight[:, k] * interface.inputs[each].scaled(0.0)
            else:
                columns.append(k)
        layers = [(np.ascontiguousarray(weight[:, columns]), first.astype(np.float32)), *others]
        weight, bias = layers[-1]
        there = [interface.clutches.index(row) for row in rows]
        layers[-1] = weight[there], bias[there]
        base = interface.base
        own = replace(
            interface,
            inputs=tuple(each for each in inputs if each is not None),
            base=base.for_machine(machine) if isinstance(base, Scaled) else base,
            reach=interface.reach * top / interface.voltage_max,
            voltage_max=top,
            clutches=rows,
        )
        return replace(self, interface=own, layers=tuple(layers))

    def _gains(
        self, base: CompiledLaw | None, layout: Layout
    ) -> tuple[dict[str, ArrayLike], Network]:
        """Return the network as gains of its law; see ``pter_gym.controllers._network``."""
        interface, sizes = self.interface, (*self.sizes[:-1], SLOTS)
        inputs = interface.inputs
        last, missing = len(self.layers) - 1, SLOTS - self.sizes[-1]
        header = Network(
            base=len(base.gains) if base else 0,
            inputs=len(inputs),
            delays=len(interface.history),
            averages=len(interface.averages),
            ring=1 + max((0, *interface.history)),
            layers=len(self.layers),
            width=max(sizes),
            normalised=float(interface.normalised),
            reach=interface.reach,
            voltage_max=interface.voltage_max,
        )
        parts: dict[str, ArrayLike] = {"network": flat(header)}
        if base:
            parts |= {name: base.gains[first:end] for name, (first, end) in base.parts.items()}
        parts |= {
            "input_sources": [source_of(each.name, layout.names) for each in inputs],
            "input_centers": [each.center for each in inputs],
            "input_scales": [each.scale for each in inputs],
            "delays": interface.history,
            "average_shares": [1.0 / steps for steps in interface.averages],
            "sizes": sizes,
        }
        for k, (weight, bias) in enumerate(self.layers):
            empty = missing if k == last else 0  # slots without a clutch
            parts[f"biases_{k}"] = np.pad(bias, (0, empty))
            parts[f"weights_{k}"] = np.pad(weight, ((0, empty), (0, 0))).T.ravel()
        return parts, header
