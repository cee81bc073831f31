"""A trained policy as an ONNX graph, for runtimes of neural networks; its caller keeps its memory.

By default the graph computes in float64, as the policy's own law does. Small processors, quantisers
and some runtimes need float32, with more than a millionth of the largest voltage of difference.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym import __version__
from pter_gym._internal.files import (
    FilePath,
    check_target,
    expand_path,
    has_ending,
    write_bytes_atomic,
)
from pter_gym.controllers import AnyPolicy, FaultTolerant
from pter_gym.controllers._network import BASE_INPUTS, INPUT_LIMIT
from pter_gym.controllers._policy import sensors_of
from pter_gym.errors import ParameterError, needs_extra
from pter_gym.params import Machine, find_machine
from pter_gym.policies import TrainedController
from pter_gym.policies._interface import input_names, input_values, to_volts
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.deploy.values import Precision, check_choice

KINDS: dict[str, Any] = {"double": np.float64, "float": np.float32}

OPSET = 18
"""Version of ONNX's operators."""


def write_onnx(
    policy: AnyPolicy,
    file: FilePath,
    *,
    name: str = "policy",
    machine: Machine | str | None = None,
    numbers: Precision = "double",
) -> Path:
    """Write a trained policy as an ONNX model with opset 18, and return the path of the file.

    Its inputs, each float32 (N, 1), are the entries of the observation that it uses, by their
    names, as they are in the observation, and ``base_1`` to ``base_4``, the voltages of the
    law that it corrects [V], −1e30 for a clutch that the law releases. A network that sees earlier
    inputs or averages also has the input ``earlier``, float32 (N, inputs · (delays + averages)):
    what the output ``inputs`` was so many steps ago, then its averages; the model's metadata has
    both lists. The output ``volts`` is float32 (N, clutches) [V].

    Parameters
    ----------
    policy, name
        A trained policy, and the model's name.
    file
        Ends in ``.onnx``.
    machine
        The nominal machine; by default the paper's.
    numbers
        Type of the graph's numbers; float makes a graph of float32 alone.

    Raises
    ------
    ParameterError
        If the policy has no network or a detector, does not fit the machine, or the file is not as
        stated. Nothing is then written.
    DependencyError
        If ``onnx`` is not installed.
    StorageError
        If the file cannot be written.
    """
    check_choice("numbers", numbers, Precision)
    path = expand_path("onnx", file)
    if not has_ending(path, ".onnx"):
        raise ParameterError(f"onnx must end in .onnx, got {str(path)!r}")
    check_target("onnx", path)
    if isinstance(policy, FaultTolerant):
        raise ParameterError(
            f"policies must be without a detector to become ONNX, got {name!r}: a graph does not "
            "remember which clutch has failed; C code does"
        )
    if not isinstance(policy, TrainedController):
        raise ParameterError(
            f"policies must be trained policies to become ONNX, {name!r} has no network"
        )
    try:
        import onnx
    except ImportError as error:
        raise needs_extra("ONNX", "deploy") from error
    machine = find_machine(machine)
    model = model_of(policy.for_machine(machine), name, machine, numbers)
    onnx.checker.check_model(model, full_check=True)
    write_bytes_atomic(path, model.SerializeToString())
    return path


class Graph:
    """Nodes and constants in the making; a method returns the name of the tensor that it makes."""

    def __init__(self, numbers: Precision) -> None:
        self.numbers = numbers.upper()
        self.kind = KINDS[numbers]
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def node(self, operator: str, *inputs: str, out: str = "", **attributes: Any) -> str:
        """Return the output of a node."""
        from onnx import helper

        name = out or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def constant(self, values: Any, kind: Any = None) -> str:
        """Return numbers, by default of the graph's type."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(values, kind or self.kind), name))
        return name

    def weights(self, values: NDArray[np.float32], name: str) -> str:
        """Return numbers that are stored as float32."""
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(values, name))
        return self.taken(name)

    def taken(self, name: str) -> str:
        """Return numbers in float32 as those of the graph."""
        return name if self.numbers == "FLOAT" else self._cast(name, self.numbers)

    def given(self, name: str, out: str) -> str:
        """Return numbers of the graph as an output, in float32."""
        return (
            self.node("Identity", name, out=out)
            if self.numbers == "FLOAT"
            else self._cast(name, "FLOAT", out)
        )

    def _cast(self, name: str, kind: str, out: str = "") -> str:
        from onnx import TensorProto

        return self.node("Cast", name, out=out, to=getattr(TensorProto, kind))

    def limited(self, x: str, low: float, high: float) -> str:
        """Return numbers limited to [low, high] as ``clamp`` does, which makes ``low`` of NaN."""
        least, most = self.constant(low), self.constant(high)
        x = self.node("Where", self.node("Greater", x, least), x, least)
        return self.node("Where", self.node("Less", x, most), x, most)

    def prune(self, outputs: Sequence[str]) -> set[str]:
        """Drop the nodes and constants that no output needs; return the tensors that are needed."""
        needed, nodes = set(outputs), list[Any]()
        for node in reversed(self.nodes):
            if needed & {*node.output}:
                nodes.append(node)
                needed |= {*node.input}
        self.nodes = nodes[::-1]
        self.constants = [each for each in self.constants if each.name in needed]
        return needed


class Columns:
    """Tensors (N, 1) of a graph that functions on arrays, (N, columns), take for one."""

    def __init__(self, graph: Graph, names: Sequence[str]) -> None:
        self.graph, self.names = graph, list(names)

    def _each(self, operator: str, left: Any, right: Any) -> "Columns":
        sides = [
            each.names
            if isinstance(each, Columns)
            else [self.graph.constant(each)] * len(self.names)
            for each in (left, right)
        ]
        pairs = zip(*sides, strict=True)
        return Columns(self.graph, [self.graph.node(operator, *pair) for pair in pairs])

    def __add__(self, other: Any) -> "Columns":
        return self._each("Add", self, other)

    def __sub__(self, other: Any) -> "Columns":
        return self._each("Sub", self, other)

    def __mul__(self, other: Any) -> "Columns":
        return self._each("Mul", self, other)

    def __rmul__(self, other: Any) -> "Columns":
        return self._each("Mul", other, self)

    def __truediv__(self, other: Any) -> "Columns":
        return self._each("Div", self, other)

    def __getitem__(self, place: tuple[slice, slice]) -> "Columns":
        return Columns(self.graph, self.names[place[1]])

    @property
    def T(self) -> "list[Columns]":
        """Its columns."""
        return [Columns(self.graph, [name]) for name in self.names]

    def __array_namespace__(self) -> "type[Columns]":
        return Columns

    @staticmethod
    def clip(x: "Columns", low: float, high: float) -> "Columns":
        """Return numbers limited to [low, high]."""
        return Columns(x.graph, [x.graph.limited(name, low, high) for name in x.names])

    @staticmethod
    def maximum(x: "Columns", least: float) -> "Columns":
        """Return numbers that are at least so large."""
        return x._each("Max", x, least)

    @staticmethod
    def concat(arrays: "Sequence[Columns]", **_: int) -> "Columns":
        """Return columns beside each other."""
        return Columns(arrays[0].graph, [name for each in arrays for name in each.names])

    stack = concat

    def joined(self) -> str:
        """Return the columns as one tensor."""
        return self.graph.node("Concat", *self.names, axis=1)


def model_of(policy: TrainedController, name: str, machine: Machine, numbers: Precision) -> Any:
    """Return the ONNX model of a trained policy, after a check that it fits the machine."""
    from onnx import TensorProto, helper

    layout, interface = observation_layout(machine, sensors_of(policy)), policy.interface
    policy.bind(machine, layout)
    graph, count, clutches = Graph(numbers), len(interface.inputs), len(interface.clutches)
    residual, names = interface.base is not None, (*layout.names, *BASE_INPUTS)
    entries = {entry: graph.taken(entry) for entry in names}
    scaled = [
        entries[entry] if scale == 1.0 else graph.node("Mul", entries[entry], graph.constant(scale))
        for entry, scale in zip(layout.names, layout.scales.tolist(), strict=True)
    ]
    base = Columns(graph, [entries[each] for each in BASE_INPUTS])
    values = input_values(Columns(graph, scaled), layout, base if residual else None)
    columns = dict(zip(input_names(layout, residual=residual), values.names, strict=True))
    x = Columns(graph, [columns[each.name] for each in interface.inputs]).joined()
    x = graph.node("Sub", x, graph.constant([each.center for each in interface.inputs]))
    x = graph.node("Div", x, graph.constant([each.scale for each in interface.inputs]))
    x = graph.limited(x, -INPUT_LIMIT, INPUT_LIMIT)
    earlier = interface.size - count
    if earlier:
        graph.given(x, out="inputs")
        x = graph.node("Concat", x, graph.taken("earlier"), axis=1)
    for layer, (weight, bias) in enumerate(policy.layers):
        weights = graph.weights(weight, f"layer_{layer}.weight")
        x = graph.node("Gemm", x, weights, graph.weights(bias, f"layer_{layer}.bias"), transB=1)
        x = graph.node("Tanh", x) if layer < len(policy.layers) - 1 else x
    places = (graph.constant([k], np.int64) for k in range(clutches))
    outputs = Columns(graph, [graph.node("Gather", x, place, axis=1) for place in places])
    middle = graph.constant([[0.5 * interface.voltage_max]])
    volts = to_volts(outputs, base if residual else Columns(graph, [middle] * clutches), interface)
    graph.given(volts.joined(), out="volts")
    widths = {"volts": clutches} | ({"inputs": count} if earlier else {})
    needed = graph.prune(list(widths))
    sizes = dict.fromkeys(names, 1) | {"earlier": earlier}
    ends, starts = (
        [
            helper.make_tensor_value_info(tensor, TensorProto.FLOAT, ["N", size])
            for tensor, size in side.items()
            if tensor in needed
        ]
        for side in (widths, sizes)
    )
    whole = helper.make_graph(graph.nodes, name, starts, ends, graph.constants)
    model = helper.make_model(
        whole,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=9,
        producer_name="pter_gym",
        producer_version=__version__,
    )
    steps = {"history": interface.history, "averages": interface.averages}
    helper.set_model_props(model, {key: " ".join(map(str, each)) for key, each in steps.items()})
    return model
