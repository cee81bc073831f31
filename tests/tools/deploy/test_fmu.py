"""Units of the arm and of policies, in FMPy: descriptions, bits, and what they refuse."""

import ctypes
import importlib.util
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
import web_module

from pter_agents.command import export
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.errors import DependencyError, ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, Machine, find_machine
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tools.deploy import Unit, arm_unit, find_unit, fmu as tool, policy_unit
from pter_gym.tools.deploy.description import exponents

fmpy = pytest.importorskip("fmpy")
fmi3 = pytest.importorskip("fmpy.fmi3")
validate = pytest.importorskip("fmpy.validation").validate_fmu
FMU2Slave = pytest.importorskip("fmpy.fmi2").FMU2Slave
FMICallException = pytest.importorskip("fmpy.fmi1").FMICallException

NATIVE = Path(__file__).parents[1] / "web" / "native.py"

pytestmark = pytest.mark.skipif(
    not (shutil.which("cc") or importlib.util.find_spec("ziglang")), reason="there is no compiler"
)
needs_zig = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed"
)

COMPILE_UNITS = tool.compile_units

HYSTERESIS = 1.2
LOOPED = replace(BASELINE, clutch=replace(BASELINE.clutch, hysteresis=HYSTERESIS))

PERIOD = 0.01
VOLTS = [f"volts_{k}" for k in range(1, 5)]
SEEN = [f"telemetry.{name}" for name in TELEMETRY.names]
TIP = ["telemetry.tip_x", "telemetry.tip_y"]
DISCARDED, ERROR = 2, 3
TERMINATED = 3


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Units whose kernels are compiled once, without optimisation, which changes no bits."""
    place = tmp_path_factory.mktemp("objects")
    compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
    options = [*compiler, "-std=c99", "-ffp-contract=off", "-O0", "-fPIC", "-fvisibility=hidden"]
    strict = ["-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter"]

    def compile_units(folder: Path, units: Any, library: Path, target: str) -> None:
        for name in units:
            shared = name == "module.c"
            compiled = (place if shared else folder) / f"{name}.o"
            if not (shared and compiled.exists()):
                warned = [] if name == "pter.c" else strict
                command = [*options, *warned, "-c", name, "-o", str(compiled)]
                subprocess.run(command, cwd=folder, check=True)
        objects = [str((place if each == "module.c" else folder) / f"{each}.o") for each in units]
        subprocess.run([*compiler, "-shared", *objects, "-o", str(library), "-lm"], check=True)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tool, "compile_units", compile_units)
        yield


@cache
def extracted(file: Path) -> str:
    """The folder of a unit, whose instances share a library."""
    return fmpy.extract(str(file), str(file.with_suffix("")))


class Arm:
    """An instance of a unit, whose variables have names."""

    def __init__(self, file: Path, token: str | None = None) -> None:
        found = fmpy.read_model_description(str(file))
        self.references = {each.name: each.valueReference for each in found.modelVariables}
        self.log: list[str] = []
        self.slave: Any = fmi3.FMU3Slave(
            guid=token or found.instantiationToken,
            unzipDirectory=extracted(file),
            modelIdentifier=found.coSimulation.modelIdentifier,
            instanceName="arm",
        )
        self.steps = 0
        self.slave.instantiate(
            logMessage=lambda _, __, ___, message: self.log.append(message.decode())
        )

    def begin(self, **parameters: float) -> "Arm":
        self.set(**parameters)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        for name, value in values.items():
            setter = self.slave.setInt32 if name in ("episode", "seed") else self.slave.setFloat64
            setter([self.references[name]], [value])

    def get(self, names: list[str]) -> Any:
        return np.array(self.slave.getFloat64([self.references[name] for name in names]))

    def push(self, volts: Any) -> None:
        self.slave.setFloat64([self.references[name] for name in VOLTS], list(volts))

    def step(self, count: int = 1) -> bool:
        _, is_over, _, reached = self.slave.doStep(PERIOD * self.steps, PERIOD * count)
        self.steps = round(reached / PERIOD)
        return is_over

    def free(self) -> None:
        self.slave.freeInstance()


@pytest.fixture(scope="module")
def plant(quick: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    unit = arm_unit(find_episodes("standard", "medium", machine=LOOPED))
    return unit.write(tmp_path_factory.mktemp("plant") / "arm.fmu")


@pytest.fixture(scope="module")
def closed(quick: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    unit = find_unit(find_policy("residual"), name="residual", machine=LOOPED)
    return unit.write(tmp_path_factory.mktemp("closed") / "closed.fmu")


@pytest.fixture(scope="module")
def functions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The module's sine and the like, for the package to compute with."""
    path = tmp_path_factory.mktemp("functions") / "functions.so"
    web_module.native_functions(path)
    return path


@pytest.fixture
def arm(plant: Path) -> Iterator[Arm]:
    arm = Arm(plant)
    yield arm
    arm.free()


def recorded(
    functions: Path,
    folder: Path,
    count: int,
    steps: int,
    hand: str = "own",
    hysteresis: float = 0.0,
) -> Any:
    """Telemetry and observations of the policy ``residual`` in the package's episodes."""
    file = folder / "episodes.npz"
    told = ("episodes", file, "residual", count, steps, hand, hysteresis)
    subprocess.run([sys.executable, NATIVE, functions, *map(str, told)], check=True)
    return np.load(file)


def check_bits(plant: Path, closed: Path, run: Any) -> None:
    """Both units have the telemetry and the observations of the package's episodes."""
    seen = [name for name in Arm(plant).references if name.startswith("observation.")]
    for episode, row in enumerate(np.moveaxis(run["telemetry"], 1, 0)):
        expected = row[~np.isnan(row[:, 0])]
        for file in (plant, closed):
            arm = Arm(file).begin(episode=episode)
            for step, (told, observed) in enumerate(
                zip(expected, run["observations"][:, episode], strict=False)
            ):
                if step:
                    if file == plant:
                        arm.push(told[[*COLUMN.volts]])
                    is_over = arm.step()
                    assert is_over == (told[COLUMN.terminated] == 1.0)
                np.testing.assert_array_equal(arm.get(SEEN), told)
                np.testing.assert_array_equal(arm.get(seen), observed)
            arm.free()


@pytest.mark.slow
@needs_zig
def test_an_episode_has_the_bits_of_the_package(
    plant: Path, closed: Path, functions: Path, tmp_path: Path
) -> None:
    check_bits(plant, closed, recorded(functions, tmp_path, 1, 60, hysteresis=HYSTERESIS))


@pytest.mark.long
@needs_zig
def test_ten_episodes_have_the_bits_of_the_package(
    functions: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the compiler's optimisation, to the end of each episode."""
    monkeypatch.setattr(tool, "compile_units", COMPILE_UNITS)
    plant = find_unit().write(tmp_path / "arm.fmu")
    closed = find_unit(find_policy("residual")).write(tmp_path / "closed.fmu")
    run = recorded(functions, tmp_path, 10, 1000)
    assert (run["telemetry"][..., COLUMN.terminated] == 1.0).any(axis=0).all()
    check_bits(plant, closed, run)


@pytest.mark.slow
@needs_zig
def test_a_force_as_an_input_is_a_recorded_one(
    quick: None, functions: Path, tmp_path: Path
) -> None:
    """The hand's force comes to that of the inputs in the course of a control step."""
    run = recorded(functions, tmp_path, 1, 40, "recorded")
    arm = Arm(find_unit(hand="open").write(tmp_path / "open.fmu")).begin()
    for told, force in zip(run["telemetry"][1:, 0], run["forces"], strict=False):
        arm.set(force_x=force[0], force_y=force[1])
        arm.push(told[[*COLUMN.volts]])
        arm.step()
        np.testing.assert_array_equal(arm.get(SEEN), told)


@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize(
    "made",
    [
        lambda version: find_unit(version=version),
        lambda version: find_unit(hand="open", version=version),
        lambda version: find_unit(find_policy("residual"), version=version),
        lambda version: policy_unit(find_policy("impedance"), version=version),
    ],
    ids=["arm", "open", "closed", "policy"],
)
def test_descriptions_are_valid(made: Callable[[Any], Unit], version: Any, tmp_path: Path) -> None:
    file = tmp_path / "unit.fmu"
    file.write_bytes(made(version).packed({}))
    assert validate(str(file)) == []
    description = fmpy.read_model_description(str(file))
    assert description.fmiVersion == version
    units = {each.name: each.unit for each in description.modelVariables}
    assert units["volts_1" if "volts_1" in units else "pace"] in ("V", "m/s")
    assert all(each.description for each in description.modelVariables)


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("N·s/m", {"kg": 1, "m": 0, "s": -1}),
        ("m/s²", {"m": 1, "s": -2}),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("1/J", {"kg": -1, "m": -2, "s": 2}),
    ],
)
def test_units_have_their_base_units(unit: str, powers: dict[str, int]) -> None:
    assert exponents(unit) == powers


def test_a_unit_has_the_same_bytes_again() -> None:
    first, second = (find_unit().packed({}) for _ in range(2))
    assert first == second


def test_a_long_communication_step_is_several_control_steps(arm: Arm, plant: Path) -> None:
    other = Arm(plant).begin()
    arm.begin()
    arm.push([6.0, 0.0, 3.0, 0.0])
    other.push([6.0, 0.0, 3.0, 0.0])
    arm.step(12)
    for _ in range(12):
        other.step()
    np.testing.assert_array_equal(arm.get(SEEN), other.get(SEEN))
    assert arm.get(["time"]) == other.get(["time"]) == pytest.approx(12 * PERIOD)
    other.free()


def test_the_episode_ends_the_simulation(arm: Arm) -> None:
    arm.begin()
    assert arm.step(20_000)
    assert arm.get(["telemetry.terminated"]) == 1.0
    assert arm.get(["telemetry.time"]) == pytest.approx(PERIOD * arm.steps)
    assert arm.steps < 2000
    with pytest.raises(FMICallException):
        arm.step()
    assert "the episode has ended" in arm.log[-1]


def test_a_reset_begins_again(arm: Arm) -> None:
    arm.begin(episode=3, seed=5)
    first = arm.get(SEEN)
    arm.step(7)
    assert (arm.get(SEEN) != first).any()
    arm.slave.reset()
    arm.steps = 0
    arm.begin(episode=3, seed=5)
    np.testing.assert_array_equal(arm.get(SEEN), first)


def test_episodes_differ(plant: Path) -> None:
    assert len({tip_after(plant, episode=episode) for episode in range(10)}) == 10


def test_a_seed_decides_what_a_reset_draws(quick: None, tmp_path: Path) -> None:
    task = PathFollowing(hand=MultiSineHand(random_phases=True))
    file = arm_unit(episode(task)).write(tmp_path / "arm.fmu")
    assert tip_after(file) == tip_after(file, seed=7) != tip_after(file, seed=8)


def episode(task: PathFollowing, machine: Machine = BASELINE, seed: int = 7) -> Episodes:
    return Episodes("a task", (machine,), (task,), (seed,), ("",))


def tip_after(file: Path, **parameters: float) -> tuple[float, ...]:
    """Where the tip is after a few steps."""
    arm = Arm(file).begin(**parameters)
    arm.step(10)
    tip = tuple(arm.get(TIP))
    arm.free()
    return tip


def test_parameters_change_the_arm(plant: Path) -> None:
    ended = {}
    for name, value in {"pace": 0.25, "strength_1": 0.5, "more_push": 5.0}.items():
        arm = Arm(plant).begin(**{name: value})
        arm.push([8.0, 0.0, 0.0, 0.0])
        arm.step(10)
        ended[name] = arm.get(["telemetry.torque_1", "telemetry.hand_work"])
        arm.free()
    assert abs(ended["strength_1"][0]) == pytest.approx(0.5 * abs(ended["pace"][0]), rel=1e-6)
    assert ended["more_push"][1] > ended["pace"][1]


def test_a_state_is_saved_and_restored_in_mid_episode(arm: Arm, plant: Path) -> None:
    arm.begin(episode=2)
    arm.push([2.0, 1.0, 0.0, 3.0])
    arm.step(9)
    state = arm.slave.getFMUState()
    data = arm.slave.serializeFMUState(state)
    arm.step(11)
    expected = arm.get(SEEN)
    arm.slave.setFMUState(state)
    arm.steps = 9
    arm.step(11)
    np.testing.assert_array_equal(arm.get(SEEN), expected)
    other = Arm(plant)
    restored = other.slave.deserializeFMUState(data)
    other.slave.setFMUState(restored)
    other.steps = 9
    other.step(11)
    np.testing.assert_array_equal(other.get(SEEN), expected)
    for each, saved in ((arm, state), (other, restored)):
        each.slave.freeFMUState(saved)
    other.free()


def test_instances_and_threads_do_not_meet(plant: Path) -> None:
    def ride(episode: int) -> Any:
        arm = Arm(plant).begin(episode=episode)
        arm.push([float(episode), 0.0, 1.0, 0.0])
        rows = []
        for _ in range(20):
            arm.step()
            rows.append(arm.get(SEEN))
        arm.free()
        return np.array(rows)

    alone = [ride(episode) for episode in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(ride, range(4)))
    np.testing.assert_array_equal(together, alone)


def test_a_thousand_instances_leave_nothing(plant: Path) -> None:
    library: Any = ctypes.CDLL(str(next((Path(extracted(plant)) / "binaries").rglob("pter.*"))))
    instantiate, free = library.fmi3InstantiateCoSimulation, library.fmi3FreeInstance
    instantiate.restype, free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    token = fmpy.read_model_description(str(plant)).instantiationToken.encode()
    rest = (b"", False, False, False, False, None, ctypes.c_size_t(0), None, None, None)
    used = []
    for _ in range(10):
        for _ in range(100):
            instance = instantiate(b"arm", token, *rest)
            assert instance
            free(instance)
        used.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert used[-1] - used[0] < 2_000


def wrong(arm: Arm, mistake: str) -> None:
    begun = {
        "nan": lambda: arm.push([np.nan, 0.0, 0.0, 0.0]),
        "high": lambda: arm.push([0.0, 24.1, 0.0, 0.0]),
        "negative": lambda: arm.push([0.0, 0.0, -1.0, 0.0]),
        "late": lambda: arm.set(pace=0.2),
        "late-seed": lambda: arm.set(seed=1),
        "output": lambda: arm.set(**{"telemetry.tip_x": 0.0}),
        "unknown": lambda: arm.slave.getFloat64([9999]),
        "unknown-set": lambda: arm.slave.setFloat64([9999], [0.0]),
        "no-integer": lambda: arm.slave.getInt32([0]),
        "string": lambda: arm.slave.getBoolean([0]),
        "fraction": lambda: arm.slave.doStep(0.0, 0.015),
        "nothing": lambda: arm.slave.doStep(0.0, 0.0),
        "backwards": lambda: arm.slave.doStep(0.0, -0.01),
        "endless": lambda: arm.slave.doStep(0.0, 1e300),
        "nan-step": lambda: arm.slave.doStep(0.0, np.nan),
        "elsewhere": lambda: arm.slave.doStep(1.0, 0.01),
        "nan-point": lambda: arm.slave.doStep(np.nan, 0.01),
        "twice": lambda: arm.slave.enterInitializationMode(),
        "foreign": lambda: arm.slave.deserializeFMUState(b"x" * 100),
    }
    begun[mistake]()


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        ("nan", "volts_1 must be within [0, 24] V, got nan"),
        ("high", "volts_2 must be within [0, 24] V, got 24.1"),
        ("negative", "volts_3 must be within [0, 24] V, got -1"),
        ("late", "pace is a parameter"),
        ("late-seed", "seed is a parameter"),
        ("output", "telemetry.tip_x is an output"),
        ("unknown", "got 9999"),
        ("unknown-set", "got 9999"),
        ("no-integer", "integer variables must have"),
        ("string", "fmi3GetBoolean"),
        ("fraction", "multiple of the control period, 0.01 s"),
        ("nothing", "multiple of the control period"),
        ("backwards", "multiple of the control period"),
        ("endless", "up to 200 s"),
        ("nan-step", "multiple of the control period"),
        ("elsewhere", "the communication point must be 0 s, got 1 s"),
        ("nan-point", "the communication point must be 0 s"),
        ("twice", "an initialisation begins once"),
        ("foreign", "a state must be of this unit"),
    ],
)
def test_mistakes_are_refused_and_change_nothing(
    mistake: str, told: str, arm: Arm, plant: Path
) -> None:
    other = Arm(plant).begin()
    arm.begin()
    with pytest.raises(FMICallException) as refused:
        wrong(arm, mistake)
    assert refused.value.status == ERROR
    assert told in arm.log[-1]
    for each in (arm, other):
        each.push([1.0, 2.0, 3.0, 4.0])
        each.step()
    np.testing.assert_array_equal(arm.get(SEEN), other.get(SEEN))
    other.free()


@pytest.mark.parametrize("call", ["step", "terminate", "exitInitializationMode"])
def test_what_comes_too_early_is_refused(call: str, arm: Arm) -> None:
    with pytest.raises(FMICallException):
        arm.step() if call == "step" else getattr(arm.slave, call)()
    arm.begin()
    assert not arm.step()


def test_another_unit_s_token_is_refused(plant: Path) -> None:
    with pytest.raises(Exception, match="instantiate"):
        Arm(plant, token="another")


@pytest.mark.slow
def test_the_older_version_has_the_same_bits(plant: Path, quick: None, tmp_path: Path) -> None:
    arm = Arm(plant).begin()
    file = find_unit(machine=LOOPED, version="2.0").write(tmp_path / "older.fmu")
    found = fmpy.read_model_description(str(file))
    references = {each.name: each.valueReference for each in found.modelVariables}
    older: Any = FMU2Slave(
        guid=found.guid,
        unzipDirectory=extracted(file),
        modelIdentifier="pter",
        instanceName="older",
    )
    older.instantiate()
    older.setupExperiment(startTime=0.0)
    older.enterInitializationMode()
    older.exitInitializationMode()
    seen = [references[name] for name in SEEN]
    is_over = False
    while not is_over:
        np.testing.assert_array_equal(older.getReal(seen), arm.get(SEEN))
        begin, is_over = arm.steps, arm.step()
        if is_over:
            with pytest.raises(FMICallException) as ended:
                older.doStep(PERIOD * begin, PERIOD)
            assert ended.value.status == DISCARDED
        else:
            older.doStep(PERIOD * begin, PERIOD)
    np.testing.assert_array_equal(older.getReal(seen), arm.get(SEEN))
    assert older.getBooleanStatus(TERMINATED)
    older.freeInstance()
    arm.free()


@pytest.mark.slow
def test_a_policy_alone_gives_the_voltages_of_the_closed_loop(
    closed: Path, quick: None, tmp_path: Path
) -> None:
    """As near as rounding of angles moves them: float32 in the loop's observations, double alone.

    Other instances get angles that are off by that rounding, at random.
    """
    unit = policy_unit(find_policy("residual"), name="residual", machine=LOOPED)
    unit = unit.write(tmp_path / "policy.fmu")
    policies, whole = [Arm(unit).begin() for _ in range(9)], Arm(closed).begin()
    wires = {f"torque_{k}": f"observation.torque_{k}" for k in range(1, 5)}
    wires |= {f"angle_{link}": f"telemetry.theta_{link}" for link in "ab"}
    wires |= {f"velocity_{link}": f"observation.omega_{link}" for link in "ab"}
    inputs, outputs = (list(each) for each in zip(*wires.items(), strict=True))
    angles = np.array([name.startswith("angle") for name in inputs])
    rng, found, expected = np.random.default_rng(0), [], []
    for _ in range(100):
        readings = whole.get(outputs)
        for k, policy in enumerate(policies):
            off = rng.choice([-1.0, 1.0], len(inputs)) * 2.0**-24 * angles * (k > 0)
            policy.set(**dict(zip(inputs, readings * (1.0 + off), strict=True)))
        found.append([policy.get(VOLTS) for policy in policies])
        for each in (*policies, whole):
            each.step()
        expected.append(whole.get([f"telemetry.{name}" for name in VOLTS]))
    assert np.ptp(expected, axis=0).min() > 1.0
    first, *others = np.moveaxis(found, 1, 0)
    moved = np.abs(np.array(others) - first).max(axis=0)
    single = np.spacing(np.float32(BASELINE.clutch.voltage_max))
    assert (np.abs(first - expected) <= moved + single).all()
    for each in (*policies, whole):
        each.free()


def test_what_a_unit_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="clutches"):
        arm_unit(episode(PathFollowing(), find_machine("two-brakes")))
    with pytest.raises(ParameterError, match="controller"):
        find_unit(controller=True)
    with pytest.raises(ParameterError, match="hand"):
        find_unit(hand="nobody")
    with pytest.raises(ParameterError, match="version"):
        find_unit(version="1.0")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ParameterError, match=r"must end in \.fmu"):
        find_unit().write(tmp_path / "arm.zip")
    with pytest.raises(ParameterError, match="platforms"):
        find_unit().write(tmp_path / "arm.fmu", "mars")  # pyright: ignore[reportArgumentType]


def test_the_command_writes_a_unit(quick: None, tmp_path: Path) -> None:
    export(fmu=tmp_path / "arm.fmu", pace="slow", scenario="hands")
    assert validate(str(tmp_path / "arm.fmu")) == []
    with pytest.raises(ParameterError, match="fmu must be given with controller"):
        export("impedance", controller=True)
    with pytest.raises(ParameterError, match="out must be left out"):
        export("impedance", fmu=tmp_path / "x.fmu", out=tmp_path)
    with pytest.raises(ParameterError):
        export(fmu=tmp_path / "x.fmu", controller=True)
    assert not (tmp_path / "x.fmu").exists()


def test_without_a_compiler_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tool.shutil, "which", lambda _: None)
    monkeypatch.setattr(tool, "find_spec", lambda _: None)
    with pytest.raises(DependencyError, match="ziglang"):
        COMPILE_UNITS(tmp_path, (), tmp_path / "x", tool.here())


@pytest.mark.long
@needs_zig
def test_all_platforms_have_a_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "compile_units", COMPILE_UNITS)
    file = find_unit().write(tmp_path / "arm.fmu", "all")
    names = ZipFile(file).namelist()
    for platform, ending in (
        ("x86_64-linux", "so"),
        ("aarch64-linux", "so"),
        ("x86_64-windows", "dll"),
        ("x86_64-darwin", "dylib"),
        ("aarch64-darwin", "dylib"),
    ):
        assert f"binaries/{platform}/pter.{ending}" in names
    assert str(Path.home()).encode() not in file.read_bytes()
    assert os.fspath(tmp_path).encode() not in file.read_bytes()
