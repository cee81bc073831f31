"""A trained policy as an ONNX graph, for runtimes of neural networks; its caller keeps its memory.

The graph computes in float64, as the policy's own law does: float32 would differ from it by more
than a millionth of the largest voltage.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym import __version__
from pter_gym._internal.files import FilePath, check_target, find_path, write_bytes_atomic
from pter_gym._physics.arm import UnitVector, Vector, components
from pter_gym.controllers import AnyPolicy
from pter_gym.controllers._network import BASE_INPUTS, DERIVED, INPUT_LIMIT
from pter_gym.controllers._policy import sensors_of
from pter_gym.errors import ParameterError, needs_extra
from pter_gym.params import Machine, find_machine
from pter_gym.policies import TrainedPolicy
from pter_gym.policies._interface import middle_volts, to_volts
from pter_gym.tasks.path_following import observation_layout

OPSET = 18
"""Version of ONNX's operators."""


def write_onnx(
    policy: AnyPolicy, file: FilePath, *, name: str = "policy", machine: Machine | str | None = None
) -> Path:
    """Write a trained policy as an ONNX model with opset 18, and return the path of the file.

    Its inputs, each float32 (N, 1), are the entries of the observation that it uses, by their
    names, as they are in the observation, and ``base_1`` to ``base_4``, the voltages of the
    controller that it corrects [V]. A network that sees earlier inputs or averages also has the
    input ``earlier``, float32 (N, inputs · (delays + averages)): what the output ``inputs`` was so
    many decisions ago, then its averages. The output ``volts`` is float32 (N, clutches) [V].

    Parameters
    ----------
    policy, name
        A trained policy and what the model is called.
    file
        Ends in ``.onnx``.
    machine
        The nominal machine; by default the paper's.

    Raises
    ------
    ParameterError
        If the policy has no network, does not fit the machine, or the file is not as stated.
        Nothing is then written.
    DependencyError
        If ``onnx`` is not installed.
    StorageError
        If the file cannot be written.
    """
    path = find_path("onnx", file)
    if path.suffix != ".onnx":
        raise ParameterError(f"onnx must end in .onnx, got {str(path)!r}")
    check_target("onnx", path)
    if not isinstance(policy, TrainedPolicy):
        raise ParameterError(
            f"policies must be trained policies to become ONNX, {name!r} has no network"
        )
    try:
        import onnx
    except ImportError as error:
        raise needs_extra("ONNX", "deploy") from error
    model = model_of(policy, name, find_machine(machine))
    onnx.checker.check_model(model, full_check=True)
    write_bytes_atomic(path, model.SerializeToString())
    return path


class Graph:
    """Nodes and constants in the making; a method returns the name of the tensor that it makes."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.inputs: dict[str, str] = {}

    def node(self, operator: str, *inputs: str, out: str = "", **attributes: Any) -> str:
        """Return the output of a node."""
        from onnx import helper

        name = out or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def constant(self, values: Any) -> str:
        """Return float64 numbers."""
        from onnx import numpy_helper

        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(values, np.float64), name))
        return name

    def weights(self, values: NDArray[np.float32], name: str) -> str:
        """Return numbers that are stored as float32, as float64."""
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(values, name))
        return self.cast(name, "DOUBLE")

    def cast(self, name: str, kind: str, out: str = "") -> str:
        """Return numbers as FLOAT or DOUBLE."""
        from onnx import TensorProto

        return self.node("Cast", name, out=out, to=getattr(TensorProto, kind))

    def entry(self, name: str) -> str:
        """Return an input of the model as float64."""
        if name not in self.inputs:
            self.inputs[name] = self.cast(name, "DOUBLE")
        return self.inputs[name]


class Tensor:
    """A tensor of a graph, of which the package's own equations make nodes."""

    __array_ufunc__ = None

    def __init__(self, graph: Graph, name: str) -> None:
        self.graph, self.name = graph, name

    def __array_namespace__(self) -> "type[Tensor]":
        """Return what computes with tensors, of which ``to_volts`` needs ``clip`` alone."""
        return Tensor

    def clip(self, low: float, high: float) -> "Tensor":
        """Return the numbers limited to [low, high]."""
        return self._node("Clip", low, high)

    def __add__(self, other: Any) -> "Tensor":
        """Add numbers."""
        return self._node("Add", other)

    def __sub__(self, other: Any) -> "Tensor":
        """Subtract numbers."""
        return self._node("Sub", other)

    def __mul__(self, other: Any) -> "Tensor":
        """Multiply by numbers."""
        return self._node("Mul", other)

    def __truediv__(self, other: Any) -> "Tensor":
        """Divide by numbers."""
        return self._node("Div", other)

    __radd__, __rmul__ = __add__, __mul__

    def _node(self, operator: str, *others: Any) -> "Tensor":
        names = (x.name if isinstance(x, Tensor) else self.graph.constant(x) for x in others)
        return Tensor(self.graph, self.graph.node(operator, self.name, *names))


def model_of(policy: TrainedPolicy, name: str, machine: Machine) -> Any:
    """Return the ONNX model of a trained policy, after a check that it fits the machine."""
    from onnx import TensorProto, helper

    layout, interface = observation_layout(machine, sensors_of(policy)), policy.interface
    policy.bind(machine, layout)
    graph, count = Graph(), len(interface.inputs)
    scales = dict(zip(layout.names, layout.scales, strict=True))
    columns = [input_of(graph, each.name, scales).name for each in interface.inputs]
    values = Tensor(graph, graph.node("Concat", *columns, axis=1))
    values = values - [each.center for each in interface.inputs]
    values = values / [each.scale for each in interface.inputs]
    x = values.clip(-INPUT_LIMIT, INPUT_LIMIT).name
    earlier = interface.size - count
    if earlier:
        graph.cast(x, "FLOAT", out="inputs")
        x = graph.node("Concat", x, graph.entry("earlier"), axis=1)
    for layer, (weight, bias) in enumerate(policy.layers):
        weights = graph.weights(weight, f"layer_{layer}.weight")
        x = graph.node("Gemm", x, weights, graph.weights(bias, f"layer_{layer}.bias"), transB=1)
        x = graph.node("Tanh", x) if layer < len(policy.layers) - 1 else x
    clutches = len(interface.clutches)
    base: Any = middle_volts(1, interface)[:, :clutches]
    if interface.base:
        entries = map(graph.entry, BASE_INPUTS[:clutches])
        base = Tensor(graph, graph.node("Concat", *entries, axis=1))
    graph.cast(to_volts(Tensor(graph, x), base, interface).name, "FLOAT", out="volts")
    sizes = {each: earlier if each == "earlier" else 1 for each in graph.inputs}
    outputs = {"volts": clutches} | ({"inputs": count} if earlier else {})
    ends, starts = (
        [
            helper.make_tensor_value_info(tensor, TensorProto.FLOAT, ["N", size])
            for tensor, size in side.items()
        ]
        for side in (outputs, sizes)
    )
    whole = helper.make_graph(graph.nodes, name, starts, ends, graph.constants)
    return helper.make_model(
        whole,
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=9,
        producer_name="pter_gym",
        producer_version=__version__,
    )


def input_of(graph: Graph, name: str, scales: dict[str, float]) -> Tensor:
    """Return the tensor of an input of the network, in its unit."""
    if name in BASE_INPUTS:
        return Tensor(graph, graph.entry(name))
    if name not in DERIVED:
        entry, scale = Tensor(graph, graph.entry(name)), scales[name]
        return entry if scale == 1.0 else entry * scale
    _, link, part = name.split("_")
    entries = ("heading_cos", "heading_sin", f"cos_{link}", f"sin_{link}")
    numbers: Any = [Tensor(graph, graph.entry(entry)) for entry in entries]
    along_and_across: Any = components(Vector(*numbers[:2]), UnitVector(*numbers[2:]))
    return along_and_across[0 if part == "cos" else 1]
