"""What users rely on besides Python names, for the listing of `interface.py`.

Commands as they are typed, ids with digests of what they draw, infos of environments, keys and
columns of files, the serial protocol, C's header and ONNX's names, exit statuses.
"""

import inspect
import json
import re
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from struct import Struct
from types import SimpleNamespace
from typing import Any, get_type_hints

import gymnasium
import made
import numpy as np
import onnx
from gymnasium.vector import AutoresetMode
from interface import digest

from pter_agents.runs import PROGRESS, PROGRESS_COLUMNS, RunFolder
from pter_agents.settings import TrainingArguments, load_settings
from pter_gym import Trajectory
from pter_gym._commands import main
from pter_gym.benchmark import Assessment, ResultsFolder, ScenarioRun, WorstHand, leaderboards
from pter_gym.benchmark.episodes import EPISODES_ENDING, FOLDER
from pter_gym.benchmark.results import write_trajectories
from pter_gym.benchmark.scores import SCORES
from pter_gym.benchmark.tables import TABLE_ENTRIES
from pter_gym.envs import PathFollowingEnv, PathFollowingVectorEnv
from pter_gym.envs._mixin import CONTEXTS, FRAME_SKIP, find_worlds
from pter_gym.envs.sb3 import PterVecEnv
from pter_gym.params import ARRANGEMENTS, BASELINE, Machine, MachineSpread, save_machine
from pter_gym.policies import read_policy, shipped_policies
from pter_gym.policies._files import encode_policy, read_header
from pter_gym.policies._view import REACH, find_view
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, observation_layout
from pter_gym.tasks.path_following._observation import Reading
from pter_gym.tasks.path_following._telemetry import COLUMNS
from pter_gym.tools.deploy import c_program, write_onnx
from pter_gym.tools.device import DeviceReport
from pter_gym.tools.device.measures import Rendering
from pter_gym.tools.device.promise import Promise
from pter_gym.tools.hil import line, session
from pter_gym.tools.identification.bench import BENCH_COLUMNS
from pter_gym.tools.identification.log import LOG_COLUMNS
from pter_gym.tools.paper import clutch_tests, outputs, path_tests, tables
from pter_gym.tools.paper.claims import STATEMENTS, Claim
from pter_gym.tools.tuning.gains_file import add_gains
from pter_gym.tools.tuning.search import TunedGains


def lines() -> Iterator[str]:
    """Yield the lines of the listing."""
    yield from ids()
    for name in main.commands():
        yield from options(name)
    yield from exit_statuses()
    entries = {
        "policies": sorted([*shipped_policies(), *tuned_policies()]),
        "observation": observation_layout(BASELINE, "force").names,
        "privileged": PathFollowingEnv(privileged=True).privileged_layout.names,
        "telemetry": TELEMETRY.names,
    }
    for kind, names in (entries | infos() | columns() | keys_of_files()).items():
        yield f"{kind}: {' '.join(names)}"
    yield from protocol()
    yield from c_header()
    yield from onnx_names()


def ids() -> Iterator[str]:
    """Yield each id with its defaults, its spaces, and digests of its first draws and its tests."""
    for name in sorted(each for each in gymnasium.registry if each.startswith("PTER/")):
        spec = gymnasium.spec(name)
        few = {"contexts": 8} if "scenario" in spec.kwargs else {}
        worlds = find_worlds(**spec.kwargs, **few)
        drawn = digest([worlds.machines, worlds.tasks, worlds.view])
        env = PathFollowingEnv(**spec.kwargs, **few)
        spaces = f"{env.observation_space} {env.action_space}"
        limits = f"{spec.max_episode_steps} steps, threshold {spec.reward_threshold}"
        yield f"id {name}: {spec.kwargs} {drawn}, {limits}, {spaces}"
    for name in SCENARIOS:
        stored = sha256((FOLDER / f"{name}{EPISODES_ENDING}").read_bytes()).hexdigest()[:8]
        yield f"test episodes {name}: {stored}"
    for function in (find_worlds, find_view):
        for each in inspect.signature(function).parameters.values():
            if each.kind is each.KEYWORD_ONLY:
                yield f"keyword of ids {each.name}={each.default!r}"
    yield f"behind None: contexts {CONTEXTS}, frame_skip {FRAME_SKIP}, reach {REACH} of voltage_max"


def options(command: str) -> Iterator[str]:
    """Yield a line for each argument of a command, as it is typed."""
    function = main.load_command(command)
    hints = get_type_hints(function, include_extras=True)
    for each in inspect.signature(function).parameters.values():
        option, default, _ = (cell.strip("`") for cell in made.argument(hints[each.name], each, ""))
        options = [option, *made.aliases(hints[each.name])]
        among = made.choices(hints[each.name])
        words = ["pter", command, ", ".join(options), default, *(["of", *among] if among else [])]
        yield " ".join(filter(None, words))


def exit_statuses() -> Iterator[str]:
    """Yield the exit status of commands."""
    yield f"exit status: 0 done, {main.FAILED} error, {main.INTERRUPTED} interrupted"


def infos() -> dict[str, Iterable[str]]:
    """Return the keys of the infos of environments."""
    env = PathFollowingEnv(privileged=True)
    _, info = env.reset(seed=0)
    many = PathFollowingVectorEnv(
        autoreset_mode=AutoresetMode.SAME_STEP, max_episode_steps=1, privileged=True
    )
    many.reset(seed=0)
    *_, last = many.step(many.action_space.sample())
    sb3 = PterVecEnv(many)
    sb3.reset()
    _, _, _, (told,) = sb3.step(many.action_space.sample())
    return {
        "info": info,
        "info, step": env.step(env.action_space.sample())[-1],
        "infos of vector environments": last,
        "final_info": last["final_info"],
        "infos of SB3": told,
    }


def columns() -> dict[str, Iterable[str]]:
    """Return the columns of tables that commands read and write."""
    with tempfile.TemporaryDirectory() as folder:
        write_trajectories({}, file := Path(folder, "two.csv"))
        telemetry = file.read_text("utf-8").strip().split(",")
    found: dict[str, Iterable[str]] = {
        "telemetry CSV": telemetry,
        "table CSV": TABLE_ENTRIES,
        "log CSV": [f"{name} [{unit}]" for name, unit in LOG_COLUMNS.items()],
        "log CSV, --clutch": [f"{name} [{unit}]" for name, unit in BENCH_COLUMNS.items()],
        PROGRESS: PROGRESS_COLUMNS,
    }
    experiments = some_experiments()
    return found | {
        f"reproduce {name}.csv": tables.COLUMNS[name](experiments) for name in outputs.OUTPUTS
    }


def some(kind: Any, **values: Any) -> Any:
    """Return a record whose other fields are zeros."""
    return kind(**{f.name: values.get(f.name, np.zeros((1, 4))) for f in fields(kind)})


def some_experiments() -> Any:
    """Return the paper's experiments as they would be without a result."""
    moved = some(Trajectory)
    run = SimpleNamespace(telemetry=np.zeros((1, COLUMNS)))
    return SimpleNamespace(
        single_dof=[some(clutch_tests.SingleDofTest, clutch=1, locked=2, trajectory=moved)],
        step_response=some(clutch_tests.StepResponse),
        torque_curves={"baseline": some(clutch_tests.MaterialCurves)},
        sweeps={"baseline": some(path_tests.Sweep)},
        table1={"baseline": (0.0, 0.0, 0.0)},
        reversals={"baseline": some(clutch_tests.Reversal, trajectory=moved)},
        gain_sweep=some(path_tests.GainSweep),
        line_following=SimpleNamespace(runs={0.0: [run]}),
    )


def keys_of_files() -> dict[str, Iterable[str]]:
    """Return the keys of files that commands write."""
    run, report = some_run(), some_report()
    policy = read_policy("residual")
    found = TunedGains("impedance", "standard", "medium", {}, Assessment(0, 0, 0, 0), 1, 1, 0)
    training = TrainingArguments(
        algorithm="ppo",
        scenario="standard",
        pace="medium",
        steps=64,
        seed=0,
        settings=load_settings("ppo"),
    )
    spread = MachineSpread(
        machine=Machine(clutch=BASELINE.clutch, clutches=ARRANGEMENTS["two-brakes"]),
        places=("clutch.time_constant",),
        covariance=((1e-4,),),
    )
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path)
        ResultsFolder(folder).make()
        ResultsFolder(folder).add([run])
        (result,) = (folder / "runs").glob("*.json")
        save_machine(spread, folder / "machine.toml", origin="chosen: some")
        add_gains(found, folder / "gains.toml")
        RunFolder(folder).begin(training, policy.interface)
        return {
            "runs/*.json": keys(json.loads(result.read_text("utf-8"))),
            "benchmark.json": keys({"leaderboards": [leaderboards([run])[0].as_json()]}),
            "device.json": keys(report.as_json()),
            "claims.json": keys(Claim(STATEMENTS[0], 0.0).as_json()),
            "table1.json": keys(tables.table1_entries(some_experiments())),
            "machine.toml": keys(tomllib.loads((folder / "machine.toml").read_text("utf-8"))),
            "gains.toml": keys(tomllib.loads((folder / "gains.toml").read_text("utf-8"))),
            "run.json": keys(json.loads((folder / "run.json").read_text("utf-8"))),
            "policy": keys(json.loads(read_header(encode_policy(policy))["card"])["interface"]),
        }


def some_run() -> ScenarioRun:
    """Return a run that has everything that a run may have."""
    worst = WorstHand(0.1, 0.1, 8192, 12288, BASELINE, PathFollowing())
    values = {name: np.zeros(2) for name in SCORES}
    return ScenarioRun("standard", "medium", "mine", 0, None, ("", ""), values, worst=worst)


def some_report() -> DeviceReport:
    """Return a report that has everything that a report may have."""
    rendering = Rendering(*[1.0] * len(fields(Rendering)))
    promise = Promise("standard", "mine", 59, 0.1, 1.0)
    boards = leaderboards([some_run()])
    return DeviceReport("mine", "medium", rendering, rendering, {}, boards, (promise,), boards)


def keys(content: Any, place: str = "") -> list[str]:
    """Return the keys of nested data by their places."""
    if isinstance(content, Mapping):
        parts = [keys(part, f"{place}.{name}".lstrip(".")) for name, part in content.items()]
        return [key for part in parts for key in part] or [place]
    if isinstance(content, list) and content and isinstance(content[0], Mapping):
        return keys(content[0], f"{place}[]")
    return [place]


def protocol() -> Iterator[str]:
    """Yield the payloads and a frame of the serial protocol."""
    for name, value in vars(session).items():
        if isinstance(value, Struct):
            yield f"serial protocol {session.VERSION}, {name.lower()}: {value.format}"
    yield f"serial protocol {session.VERSION}, what is read: {' '.join(Reading._fields)}"
    frames = [line.framed(payload).hex() for payload in (b"", bytes(3), b"\1" * 600)]
    yield f"serial protocol {session.VERSION}, frames: {digest(frames)}"


def c_header() -> Iterator[str]:
    """Yield the macros, types and functions of exported C."""
    yield f"C: {' '.join(c_program.FILES)}"
    text = (c_program.STATIC / "pter.h").read_text("utf-8")
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    yield from (f"C: {each}" for each in re.findall(r"^#define \w+ .*?(?= *$)", text, re.MULTILINE))
    text = re.sub(r'^#.*|extern "C" \{|^\}$', "", text, flags=re.MULTILINE)
    for each in re.findall(r"(?:[^;{}]|\{[^}]*\})+;", text):
        yield f"C: {' '.join(each.split())}"


def onnx_names() -> Iterator[str]:
    """Yield the inputs and outputs of an exported network, of each kind."""
    with tempfile.TemporaryDirectory() as folder:
        for name in shipped_policies():
            graph = onnx.load(write_onnx(read_policy(name), Path(folder, "policy.onnx"))).graph
            for kind, values in (("inputs", graph.input), ("outputs", graph.output)):
                yield f"ONNX of {name}, {kind}: {' '.join(each.name for each in values)}"
