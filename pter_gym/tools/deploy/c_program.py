"""A policy as a program in C: ``pter.h``, ``pter.c`` and ``main.c``, a filter for observations.

``prove.c`` is what Frama-C proves of it.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import layout_of, read
from pter_gym._internal.files import FilePath, expand_path, make_folder, write_files_atomic
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.model import model_of
from pter_gym.controllers import AnyPolicy, FaultTolerant, Policy, bind
from pter_gym.controllers._policy import CompiledLaw, sensors_of
from pter_gym.errors import ParameterError
from pter_gym.params import Machine, find_machine
from pter_gym.paths import Path as Curve, find_path
from pter_gym.policies import TrainedController
from pter_gym.tasks.path_following import PathFollowing, observation_layout
from pter_gym.tasks.path_following._observation import ENTRIES, OBS, Observation, Reading
from pter_gym.tools.deploy.c_translator import Program
from pter_gym.tools.deploy.functions import arctangent, command, cosine, encoder, observe, sine
from pter_gym.tools.deploy.proof import DRIVER, command_for
from pter_gym.tools.deploy.values import (
    Array,
    ConstantTable,
    Expression,
    Precision,
    Region,
    Weights,
    check_choice,
)

STATIC = Path(__file__).parent / "static"

FILES = ("pter.h", "pter.c", "main.c")

ELEMENTARY = {math.sin: sine, math.cos: cosine, math.atan2: arctangent}

BITS = {
    "double": {"bits": 64, "limits": "DBL", "digits": 53, "magic": "0x5fe6eb50c7b537a9", "low": 27},
    "float": {"bits": 32, "limits": "FLT", "digits": 24, "magic": "0x5f3759df", "low": 12},
}
"""Bits of a number and of its mantissa, and what the square root does to them."""

PREFIX = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
"""How names in C may begin."""

RESERVED = ("main", "prove", "float", "stdint", "stdio", "stdlib")
"""Names of files that the program has besides its own two, and of headers that it includes."""

OWN = re.compile(
    r"^(?:static [\w ]+?|typedef (?:struct \{[^}]*\}|[\w ]+?) )\b(\w+)[(\[;]", re.MULTILINE
)
MACRO = re.compile(r"^#define (\w+)", re.MULTILINE)
"""Names that only a file of C knows: functions, tables and types; macros."""

INT8_MAX = 127

STEP_BITS = 16
"""Bits of a step: a multiple of it by a number of 8 bits is exact in float32."""


@dataclass(frozen=True)
class Source:
    """A policy in C.

    Attributes
    ----------
    files
        Content of ``pter.h``, ``pter.c`` and ``main.c`` by name.
    driver
        Content of ``prove.c``, the driver of its proof.
    policy
        The bound policy whose voltages the program gives; with weights of 8 bits, these are
        rounded.
    """

    files: dict[str, str]
    driver: str
    policy: Policy

    def write(self, folder: FilePath, *, driver: bool = False) -> Path:
        """Write the files to a folder, which is created if necessary, and return it.

        Raises a ParameterError or a StorageError if they cannot be written.
        """
        make_folder(folder, "c")
        texts = {**self.files, DRIVER: self.driver} if driver else self.files
        write_files_atomic(folder, {name: text.encode() for name, text in texts.items()})
        return expand_path("c", folder)


def source_of(
    policy: AnyPolicy,
    *,
    name: str = "policy",
    machine: Machine | str | None = None,
    path: Curve | str = "line",
    numbers: Precision = "double",
    weights: Weights = "float",
    prefix: str = "pter",
) -> Source:
    """Return a policy in C.

    Parameters
    ----------
    policy, name
        A control law or a trained policy, as ``pter_gym.benchmark.find_policy`` returns it, and its
        name in the files.
    machine
        The nominal machine, which the law knows; by default the paper's.
    path
        The path whose arcs the program holds.
    numbers, weights
        Types of the arithmetic and of the stored weights.
    prefix
        Begins the names of files, functions, types and, in capitals, macros: two policies in one
        program need different prefixes.

    Raises
    ------
    ParameterError
        If the policy is not a compiled law or cannot be translated, or another argument is not as
        stated.
    """
    check_choice("numbers", numbers, Precision)
    check_choice("weights", weights, Weights)
    machine, curve = find_machine(machine), find_path(path)
    if not PREFIX.fullmatch(prefix):
        raise ParameterError(
            f"prefix must be a letter, then letters, digits and underscores, got {prefix!r:.200}"
        )
    if prefix.lower() in RESERVED:
        raise ParameterError(f"prefix must be none of {', '.join(RESERVED)}, got {prefix!r}")
    tolerant = isinstance(policy, FaultTolerant)
    network = policy.controller if tolerant else policy
    steps = () if isinstance(network, TrainedController) else None
    if weights == "int8":
        if not isinstance(network, TrainedController):
            raise ParameterError(
                f"weights must be float for {name!r}, which has no network, got {weights!r}"
            )
        network, steps = rounded(network.for_machine(machine))
        policy = replace(policy, controller=network) if tolerant else network
    layout = observation_layout(machine, sensors_of(policy))
    bound = bind(policy, machine, layout)
    law = bound.law
    if law is None:
        raise ParameterError(
            f"policies must be laws or trained policies to become C, {name!r} is Python code"
        )
    top = machine.clutch.voltage_max
    program = Program(ELEMENTARY, single=numbers == "float")
    gains = ConstantTable(law.gains, tuple(regions(law, steps)), choices_of(law))
    scales = ConstantTable(layout.scales, (Region("observation_scales", 0, len(layout)),))
    obs, memory = (
        Array("float", "observation", "real" if program.single else "single"),
        Array("real", "memory", const=False),
    )
    program.call(command, law.function, obs, scales, gains, memory, top, whole=True)
    prepare(program, machine)
    functions_by_name: dict[str, Any] = {
        "command": " ".join(command_for(f"{prefix}.c", len(curve.arcs.table))),
        "title": f"The policy {name} for the passive arm PTER.",
        "real": numbers,
        "period": repr(bound.control_period or PathFollowing.control_period),
        "top": repr(top),
        "hold": bound.frame_skip,
        "memory": bound.start(1).shape[1],
        "entries": len(layout),
        "most": ENTRIES,
        "arcs": len(curve.arcs.table),
        "observation": "\n".join(described(layout)),
        "translated": program.source(),
        "path": path_table(curve, program),
        **BITS[numbers],
    }
    functions_by_name["path"] = renamed(functions_by_name["path"], prefix)
    texts = {
        file: Template(renamed((STATIC / file).read_text("utf-8"), prefix)).safe_substitute(
            functions_by_name
        )
        for file in (*FILES, DRIVER)
    }
    rest = {
        "digest": sha256("".join(texts.values()).encode()).hexdigest()[:8],
        **own_names(texts["pter.c"], prefix),
    }
    done = {
        file.replace("pter", prefix): Template(text).substitute(rest)
        for file, text in texts.items()
    }
    return Source(done, done.pop(DRIVER), bound)


def own_names(text: str, prefix: str) -> dict[str, str]:
    """Return directives that give a file's own names a prefix, and those that end this.

    So files of several policies can be parts of one translation unit.
    """
    names: list[str] = OWN.findall(text)
    every = (*names, *MACRO.findall(text))
    return {
        "hidden": "\n".join(f"#define {name} {prefix}_own_{name}" for name in names),
        "shown": "\n".join(f"#undef {name}" for name in every),
    }


def renamed(text: str, prefix: str) -> str:
    """Return text in C whose names begin with another prefix."""
    text = re.sub(r"\bpter(?=_(?!gym)|\.h)", prefix, text)
    return re.sub(r"\bPTER(?=_)", prefix.upper(), text)


def prepare(program: Program, machine: Machine) -> None:
    """Translate what comes before a law: encoders, and the observation from readings and a path."""
    inverse: Any = 1.0 / layout_of(Observation, machine).scales
    reading, volts = Expression(Reading, "reading"), Expression(PerClutch, "volts")
    count, real = Expression("int", "count"), Expression("real", "real")
    out, arcs = Array("real", "out", const=False), Array("real", "arcs")
    arm, scale = model_of(machine).arm, read(inverse, OBS, 0)
    program.call(observe, reading, volts, arcs, count, count, real, arm, scale, out, whole=True)
    program.call(encoder, count, count, real, real, real, whole=True)


def regions(law: CompiledLaw, steps: tuple[float, ...] | None) -> Iterator[Region]:
    """Yield the parts of a law's gains; ``steps`` are those of a network's layers."""
    for name, (first, last) in law.parts.items():
        kind, _, layer = name.rpartition("_")
        if steps is None or kind not in ("biases", "weights"):
            yield Region(name, first, last)
        elif kind == "weights" and steps:
            yield Region(name, first, last, "signed char", steps[int(layer)])
        else:
            yield Region(name, first, last, "float")


def choices_of(law: CompiledLaw) -> tuple[int, int] | None:
    """Return where the gains lie of which a law that goes on without a clutch chooses."""
    if "detector" not in law.parts:
        return None
    first, end = law.parts["without_1"]
    return law.parts["detector"][1], end - first


def rounded(policy: TrainedController) -> tuple[TrainedController, tuple[float, ...]]:
    """Return a policy with 8-bit weights, and the quantisation step of each layer."""
    steps = tuple(step_of(weight) for weight, _ in policy.layers)
    layers = tuple(
        (np.float32(np.round(weight / np.float64(step)) * step), bias)
        for (weight, bias), step in zip(policy.layers, steps, strict=True)
    )
    return replace(policy, layers=layers), steps


def step_of(weight: NDArray[np.float32]) -> float:
    """Return the step of a layer's weights."""
    mantissa, exponent = math.frexp(max(float(np.abs(weight).max()), 1e-30) / INT8_MAX)
    return math.ldexp(math.ceil(mantissa * 2**STEP_BITS), exponent - STEP_BITS)


def described(layout: Layout) -> Iterator[str]:
    """Yield a line for each entry of an observation."""
    for place, entry in enumerate(layout.fields):
        yield f"     {place:2} {entry.name:14} {entry.scale:5g} {entry.unit:6} {entry.meaning}"


def path_table(curve: Curve, program: Program) -> str:
    """Return the arcs of a path in C."""
    table = curve.arcs.table.tolist()
    rows = (", ".join(program.literal(value, "real") for value in row) for row in table)
    body = ",\n    ".join(rows)
    return f"const real pter_path_arcs[PTER_ARCS * 7] = {{\n    {body}\n}};"
