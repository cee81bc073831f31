"""Functional Mock-up Units (FMI 3.0 and 2.0, co-simulation) of the arm, with or without a policy.

The arm is the WebAssembly module of ``pter play`` in C; a policy alone is its exported C.
"""

import math
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Field
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import BASIC_ROWS, ROW, ROWS
from pter_gym._internal.files import (
    FilePath,
    check_target,
    expand_path,
    has_ending,
    write_bytes_atomic,
)
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.controllers import AnyPolicy, Policy, bind
from pter_gym.controllers._policy import sensors_of
from pter_gym.errors import DataError, DependencyError, ParameterError
from pter_gym.hands import find_hand
from pter_gym.params import Machine
from pter_gym.paths import Path as Curve
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, observation_layout
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH
from pter_gym.tasks.path_following._specification import held_machine
from pter_gym.tools.deploy.c_program import source_of
from pter_gym.tools.deploy.description import Variable, build_description, description
from pter_gym.tools.deploy.values import check_choice
from pter_gym.tools.deploy.wasm_to_c import translated
from pter_gym.tools.web.site import MODULE
from pter_gym.tools.web.tables import HANDS, LAWS, numbered_gains

STATIC = Path(__file__).parent / "static" / "fmu"

Version = Literal["3.0", "2.0"]
"""Version of FMI."""

Platforms = Literal["here", "all"]
"""This computer's platform, or all that Zig compiles for besides it."""

IDENTIFIER = "pter"

PREFIX = "kernels"
"""What the names of the module's functions begin with."""

MAX_EPISODES = 10
"""Test episodes of which a unit knows."""

LARGEST_SEED = 2**31 - 1
MAX_PACE = 5.0
ALIGNMENT = 64

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
LINKED = ("-shared", "-fvisibility=hidden")

ZIG_TARGETS = {
    "x86_64-linux": "x86_64-linux-gnu.2.17",
    "aarch64-linux": "aarch64-linux-gnu.2.17",
    "x86_64-windows": "x86_64-windows-gnu",
    "x86_64-darwin": "x86_64-macos",
    "aarch64-darwin": "aarch64-macos",
}
ENDINGS = {"linux": "so", "windows": "dll", "darwin": "dylib"}
OLDER = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64"}
"""Names of platforms in FMI 2.0."""


@dataclass(frozen=True)
class Unit:
    """A Functional Mock-up Unit.

    Attributes
    ----------
    files
        Content by name; ``sources`` has all that a compiler needs.
    units
        Names of the files in ``sources`` that are compiled.
    variables
        Inputs, parameters and outputs.
    version
        That of FMI.
    """

    files: Mapping[str, bytes]
    units: tuple[str, ...]
    variables: tuple[Variable, ...]
    version: Version

    def write(self, file: FilePath, platforms: Platforms = "here") -> Path:
        """Compile the unit and write it.

        Raises
        ------
        DependencyError
            If there is no compiler.
        ParameterError, StorageError
            If the file cannot be written.
        """
        if not has_ending(file, ".fmu"):
            raise ParameterError(f"fmu must end in .fmu, got {str(file)!r}")
        path = expand_path("fmu", file)
        check_target("fmu", path)
        write_bytes_atomic(path, self.packed(self.libraries(platforms)))
        return path

    def packed(self, libraries: Mapping[str, bytes]) -> bytes:
        """Return the bytes of the unit's file, with libraries by their names in it."""
        content = BytesIO()
        with ZipFile(content, "w", ZIP_DEFLATED) as archive:
            for name, data in {**self.files, **libraries}.items():
                entry = ZipInfo(name)  # whose date is always the same
                entry.compress_type = ZIP_DEFLATED
                archive.writestr(entry, data)
        return content.getvalue()

    def libraries(self, platforms: Platforms = "here") -> dict[str, bytes]:
        """Return the compiled libraries by their names in the unit."""
        check_choice("platforms", platforms, Platforms)
        chosen = [here(), *ZIG_TARGETS] if platforms == "all" else [here()]
        found: dict[str, bytes] = {}
        with TemporaryDirectory() as folder:
            for name, data in self.files.items():
                place = Path(folder) / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(data)
            for each in dict.fromkeys(chosen):
                ending = ENDINGS[each.partition("-")[2]]
                library = Path(folder) / f"{IDENTIFIER}.{ending}"
                compile_units(Path(folder) / "sources", self.units, library, each)
                of = OLDER.get(each, each) if self.version == "2.0" else each
                found[f"binaries/{of}/{library.name}"] = library.read_bytes()
        return found


def here() -> str:
    """Return this computer's platform, as FMI 3.0 names it."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    return f"{machine}-{platform.system().lower()}"


def compile_units(folder: Path, units: Sequence[str], library: Path, target: str) -> None:
    """Compile files of a folder to a shared library, by this computer's compiler or by Zig."""
    own = shutil.which("cc") if target == here() else None
    if own:
        compiler = [own]
    elif find_spec("ziglang") and target in ZIG_TARGETS:
        compiler = [sys.executable, "-m", "ziglang", "cc", "-target", ZIG_TARGETS[target], "-s"]
    else:
        raise DependencyError(
            f"an FMU for {target} needs a C compiler: "
            f"{'cc, or ' if target == here() else ''}Zig, by `pip install ziglang`"
        )
    flags = [*FLAGS, *LINKED, *(() if "windows" in target else ("-fPIC",))]
    command = [*compiler, *flags, *units, "-o", str(library), "-lm"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if run.returncode:
        last = "".join(run.stderr.strip().splitlines()[-1:])
        raise DataError(f"{compiler[0]} cannot compile the FMU for {target}: {last}")


def find_unit(
    policy: AnyPolicy | None = None,
    *,
    name: str = "policy",
    scenario: str = "standard",
    pace: str = "medium",
    machine: Machine | str | None = None,
    path: Curve | str | None = None,
    hand: str | None = None,
    controller: bool = False,
    version: Version = "3.0",
) -> Unit:
    """Return a unit of a policy alone or of the arm in test episodes, as ``pter export`` does.

    Parameters
    ----------
    policy, name
        Policy that sets the voltages, which otherwise are inputs, and the unit's name.
    scenario, pace, machine, path
        Which test episodes; a machine and a path replace those of the scenario.
    hand
        Name of a hand that replaces the episodes'; ``"open"`` makes its force an input.
    controller
        Whether to return the policy alone.
    version
        That of FMI.

    Raises
    ------
    ParameterError
        If there is no such scenario, pace, machine, path or hand, or the unit cannot be made.
    """
    if controller:
        if policy is None or hand is not None:
            raise ParameterError("controller must be a policy alone, without a hand")
        curve = "line" if path is None else path
        return policy_unit(
            policy, name=name, machine=machine, path=curve, pace=pace, version=version
        )
    episodes = find_episodes(find_scenario(scenario, machine, path), pace)
    episodes = episodes.first(min(len(episodes), MAX_EPISODES))
    is_open = hand == "open"
    if hand is not None and not is_open:
        held = (replace(task, hand=find_hand(hand)) for task in episodes.tasks)
        episodes = replace(episodes, tasks=tuple(held), time_limits=())
    return arm_unit(episodes, policy, name=name, open_hand=is_open, version=version)


def arm_unit(
    episodes: Episodes,
    policy: AnyPolicy | None = None,
    *,
    name: str = "arm",
    open_hand: bool = False,
    version: Version = "3.0",
) -> Unit:
    """Return a unit of the simulated arm in test episodes.

    Parameters
    ----------
    episodes
        Test episodes, of which the unit has the first ``MAX_EPISODES``.
    policy, name
        Policy that sets the voltages, which are inputs by default, and the unit's name.
    open_hand
        Whether the force on the tip is an input instead of the hand's.
    version
        That of FMI.

    Raises
    ------
    ParameterError
        If the module of ``pter play`` has no such policy or clutches.
    """
    check_choice("version", version, Version)
    episodes = episodes.first(min(len(episodes), MAX_EPISODES))
    if open_hand:
        pointed = (replace(task, hand=HANDS["pointer"]) for task in episodes.tasks)
        episodes = replace(episodes, tasks=tuple(pointed), time_limits=())
    if not all(each.has_paper_clutches for each in episodes.machines):
        raise ParameterError(
            "machine must have the paper's clutches, which are those of the module of `pter play`"
        )
    batch = Batch(episodes.machines, episodes.tasks, sensors="force")
    bound = None if policy is None else bound_policy(policy, name, episodes)
    variables = tuple(arm_variables(batch, episodes, closed=bound is not None, pushed=open_hand))
    data = arm_data(batch, episodes, bound, variables, pushed=open_hand)
    kind = "with " + name if bound else "with voltages as inputs"
    title = f"The passive arm PTER in test episodes of {episodes.scenario}, {kind}"
    files = {"arm_data.h": data, "arm.c": static("arm.c")}
    files |= kernels()
    return unit_of(title, files, variables, batch.task.control_period, version)


def policy_unit(
    policy: AnyPolicy,
    *,
    name: str = "policy",
    machine: Machine | str | None = None,
    path: Curve | str = "line",
    pace: str | float = "medium",
    version: Version = "3.0",
) -> Unit:
    """Return a unit of a policy alone, from sensors' readings to voltages; see ``source_of``."""
    check_choice("version", version, Version)
    source = source_of(policy, name=name, machine=machine, path=path)
    variables = tuple(policy_variables(find_pace(pace)))
    period = source.policy.control_period or PathFollowing.control_period
    files = {
        "policy_data.h": defined(references(variables)),
        "policy.c": static("policy.c"),
        "pter.c": source.files["pter.c"],
        "pter.h": source.files["pter.h"],
    }
    title = f"The policy {name} for the passive arm PTER"
    return unit_of(title, files, variables, period, version)


def unit_of(
    title: str,
    files: Mapping[str, str],
    variables: Sequence[Variable],
    period: float = PathFollowing.control_period,
    version: Version = "3.0",
) -> Unit:
    """Return a unit of a model in C.

    Parameters
    ----------
    title
        What it is, in a line.
    files
        Its source files by name, which define what ``model.h`` declares.
    variables
        Its variables, the real ones first: the numbers of ``model.h`` in their order.
    period
        Its control period [s].
    version
        That of FMI.
    """
    api = f"fmi{version[0]}.c"
    common = {file: static(file) for file in (api, "instance.c", "instance.h", "model.h")}
    sources = {**common, **files, "variables.h": tables_of(variables)}
    units = tuple(file for file in sources if file.endswith(".c"))
    whole = repr([title, period, version, *sources.items(), *variables]).encode()
    token = sha256(whole).hexdigest()[:32]
    numbers = sum(not each.whole for each in variables)
    sources["data.h"] = defined(
        {
            "NUMBERS": numbers,
            "INTEGERS": len(variables) - numbers,
            "TIME": len(variables),
            "PERIOD": repr(period),
            "TOKEN": f'"{token}"',
            "DIGEST": f"UINT64_C(0x{token[:16]})",
        }
    )
    described = description(title, IDENTIFIER, token, variables, period, units, version)
    plain = {"modelDescription.xml": described}
    if version == "3.0":
        plain["sources/buildDescription.xml"] = build_description(IDENTIFIER, units, FLAGS)
    plain |= {f"sources/{file}": text for file, text in sources.items()}
    content = {file: text.encode() for file, text in plain.items()}
    return Unit(content, units, tuple(variables), version)


@cache
def kernels() -> dict[str, str]:
    """Return the source files of the module."""
    return translated(MODULE.read_bytes(), PREFIX)


def static(file: str) -> str:
    """Return a source file that all units have alike."""
    return (STATIC / file).read_text("utf-8")


def bound_policy(policy: AnyPolicy, name: str, episodes: Episodes) -> Policy:
    """Return a policy for the nominal machine, or raise a ParameterError."""
    layout = observation_layout(episodes.machines[0], sensors_of(policy))
    bound = bind(policy, episodes.nominal, layout)
    bound.check_period(episodes.tasks[0].control_period)
    if bound.law is None or bound.law.function not in LAWS:
        raise ParameterError(
            "policies must be laws or trained policies of the package, without a detector, to act "
            f"in an FMU, got {name!r}; `--controller` takes any that becomes C"
        )
    return bound


# --- variables ---


def arm_variables(
    batch: Batch, episodes: Episodes, *, closed: bool, pushed: bool
) -> Iterable[Variable]:
    """Yield the variables of an arm."""
    top, task = batch.machine.clutch.voltage_max, batch.task
    for k in range(0 if closed else 4):
        yield Variable(f"volts_{k + 1}", "input", "V", f"voltage of clutch {k + 1}", 0.0, 0.0, top)
    if pushed:
        most = math.floor(held_machine(task, batch.machine).force / math.sqrt(2.0))
        for axis in "xy":
            meaning = "force of a hand on the tip, reached at the end of a control step"
            yield Variable(f"force_{axis}", "input", "N", meaning, 0.0, -most, most)
    pace = "commanded mean speed along the path"
    yield Variable("pace", "parameter", "m/s", pace, task.pace, 1e-3, MAX_PACE)
    for k in range(4):
        meaning = f"torque of clutch {k + 1}, relative to that of the episode's machine"
        yield Variable(f"strength_{k + 1}", "parameter", "1", meaning, 1.0, 0.0, 10.0)
    more = "constant force along the path besides the hand's"
    yield Variable("more_push", "parameter", "N", more, 0.0, -100.0, 100.0)
    for field in TELEMETRY.fields:
        yield output("telemetry", field)
    for field in batch.layout.fields:
        yield output("observation", field)
    last, seed = len(episodes) - 1, "seed of the episode, −1 for that of the test episode"
    number = "number of the test episode"
    yield Variable("episode", "parameter", "1", number, 0, 0, last, whole=True)
    yield Variable("seed", "parameter", "1", seed, -1, -1, LARGEST_SEED, whole=True)


def policy_variables(pace: float) -> Iterable[Variable]:
    """Yield the variables of a policy."""
    for name, unit, meaning in (("angle", "rad", "angle"), ("velocity", "rad/s", "velocity")):
        for link in "ab":
            yield read(f"{name}_{link}", unit, f"{meaning} of link {link.upper()}")
    for k in range(4):
        yield read(f"torque_{k + 1}", "N·m", f"torque that clutch {k + 1} generates")
    for direction in ("along", "across"):
        yield read(f"force_{direction}", "N", f"the hand's force {direction} the path")
    speed = "commanded mean speed along the path"
    yield Variable("pace", "parameter", "m/s", speed, pace, 1e-3, MAX_PACE)
    for k in range(4):
        meaning = f"voltage of clutch {k + 1}"
        yield Variable(f"volts_{k + 1}", "output", "V", meaning, 0.0, direct=True)


def read(name: str, unit: str, meaning: str) -> Variable:
    """Return the variable of a sensor."""
    return Variable(name, "input", unit, meaning, 0.0, -1e6, 1e6)


def output(group: str, field: Field) -> Variable:
    """Return the variable of an entry of the telemetry or of the observation."""
    return Variable(f"{group}.{field.name}", "output", field.unit, field.meaning, 0.0)


def references(variables: Sequence[Variable]) -> dict[str, object]:
    """Return where groups of variables begin, by their names in C."""
    names = [each.name for each in variables if not each.whole]
    groups = {
        "VOLTS": "volts_1",
        "FORCE": "force_x",
        "PACE": "pace",
        "STRENGTH": "strength_1",
        "MORE_PUSH": "more_push",
        "TELEMETRY": f"telemetry.{TELEMETRY.names[0]}",
        "OBSERVATION": "observation.cos_a",
        "ANGLE": "angle_a",
        "VELOCITY": "velocity_a",
        "TORQUE": "torque_1",
    }
    if "force_along" in names:
        groups["FORCE"] = "force_along"
    return {name: names.index(first) for name, first in groups.items() if first in names}


# --- source text ---


def defined(values: Mapping[str, object]) -> str:
    """Return macros in C."""
    return "".join(f"#define {name} {value}\n" for name, value in values.items())


def number(value: float) -> str:
    """Return a number in C, exactly."""
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(float(value)) if float(value).is_integer() else float(value).hex()


def table(kind: str, name: str, values: Iterable[str]) -> str:
    """Return a table in C, of at least one entry."""
    entries = list(values) or ["0"]
    rows = (", ".join(entries[k : k + 8]) for k in range(0, len(entries), 8))
    body = ",\n    ".join(rows)
    return f"static const {kind} {name}[] = {{\n    {body}\n}};\n"


def numbers_table(name: str, values: NDArray[np.float64] | Sequence[float]) -> str:
    """Return a table of numbers in C."""
    return table("double", name, map(number, np.asarray(values, np.float64).ravel().tolist()))


def whole_number(value: float) -> str:
    """Return a whole number in C."""
    return str(int(value))


def tables_of(variables: Sequence[Variable]) -> str:
    """Return the tables of variables in C."""
    parts: list[str] = []
    for word, whole, text in (("number", False, number), ("integer", True, whole_number)):
        own = [each for each in variables if each.whole == whole]
        kind = "int32_t" if whole else "double"
        parts += [
            table("char *const", f"{word}_names", (f'"{each.name}"' for each in own)),
            *(
                table(kind, f"{name}_{word}s", map(text, (getattr(each, name) for each in own)))
                for name in ("start", "least", "most")
            ),
        ]
        if not whole:
            kinds = (each.causality.upper() for each in own)
            units = (f'"{"" if each.unit == "1" else each.unit}"' for each in own)
            parts += [
                table("unsigned char", "number_kinds", kinds),
                table("char *const", "number_units", units),
            ]
    return "".join(parts)


def arm_data(
    batch: Batch,
    episodes: Episodes,
    policy: Policy | None,
    variables: Sequence[Variable],
    *,
    pushed: bool,
) -> str:
    """Return what an arm's C needs to know: places, and the constants of its episodes."""
    arrays = batch.kernel_arrays()
    config, constants = arrays["config"], arrays["constants"]
    gains: list[float] = []
    memory = np.zeros(1)
    if policy is not None:
        gains, memory = numbered_gains(policy), policy.start(1, [1])[0]
    heap = f"({PREFIX.upper()}_HEAP + {ALIGNMENT - 1}) / {ALIGNMENT} * {ALIGNMENT}"
    sizes = {
        "CONFIG": 8 * config.size,
        "CONSTANTS": 8 * constants.size,
        "SCALES": 8 * len(batch.layout),
        "GAINS": 8 * len(gains),
        "WORLD": 8 * ROWS,
        "WORDS": 16,
        "OBSERVATION": 4 * len(batch.layout),
        "TELEMETRY": 8 * len(TELEMETRY),
        "CONTEXT": 8 * CONTEXT_WIDTH,
        "FORCES": 32,
        "VOLTS": 32,
        "HELD": 8,
        "MEMORY": 8 * memory.size,
        "END": 0,
    }
    places, at = dict[str, object](), 0
    for name, size in sizes.items():
        places[f"AT_{name}"] = f"(HEAP + {at})"
        at += -(-size // ALIGNMENT) * ALIGNMENT
    context: Any = CONTEXT
    marked = np.flatnonzero(memory)
    values: dict[str, object] = {
        "HEAP": f"({heap})",
        **places,
        **references(variables),
        "EPISODE": 0,
        "SEED": 1,
        "ENTRIES": len(batch.layout),
        "SEEN": len(policy.layout) if policy else 0,
        "TELEMETRY_COUNT": len(TELEMETRY),
        "CONTEXT_WIDTH": CONTEXT_WIDTH,
        "CONTEXT_INDEX": "((AT_CONTEXT - AT_CONSTANTS) / 8)",
        "FORCES_INDEX": "((AT_FORCES - AT_CONSTANTS) / 8)",
        "CONTEXT_PACE": int(context.task.pace),
        "CONTEXT_INTENT_SPEED": int(context.hand.intent_speed),
        "CONTEXT_RECORD_FIRST": int(context.hand.record_first),
        "CONTEXT_PUSH": int(context.hand.push),
        "CONTEXT_SCALE": int(context.machine.scale.x1),
        "CONTEXT_VISCOUS": int(context.machine.sliding.viscous.x1),
        "ROW_DRAWS_FROM": int(ROW.draws_from),
        "ROW_DRAWS": int(ROW.draws),
        "ROW_STEP": int(ROW.step),
        "ROW_ALIVE": int(ROW.alive),
        "ROW_RECORD_FIRST": int(ROW.hand.record_first),
        "ROW_RECORD_COUNT": int(ROW.hand.record_count),
        "ROW_HEADING_COS": int(ROW.foot.heading.cos),
        "ROW_HEADING_SIN": int(ROW.foot.heading.sin),
        "GUIDES": int(pushed or arrays["worlds"].shape[1] > BASIC_ROWS),
        "HAS_FORCE": int(pushed),
        "HAS_POLICY": int(policy is not None),
        "HOLD": policy.frame_skip if policy else 1,
        "LAW_MEMORY": memory.size,
        "LAW_EPISODE": int(marked[0]) if marked.size else -1,
        "VOLTAGE_MAX": number(batch.machine.clutch.voltage_max),
    }
    blocks, lanes = arrays["worlds"].shape[::2]
    rows = arrays["worlds"][:, int(ROW.draws_from), :].reshape(blocks * lanes)[: len(episodes)]
    parts = [
        defined(values),
        table("uint64_t", "seeds", (f"UINT64_C({seed})" for seed in episodes.seeds)),
        table("uint32_t", "contexts", (str(int(row)) for row in rows)),
        numbers_table("observation_scales", batch.layout.scales),
        numbers_table("config", config),
        numbers_table("constants", constants),
        numbers_table("gains", gains) if gains else "",
    ]
    return "#include <math.h>\n\n" + "".join(parts)
