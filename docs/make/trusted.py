"""Write the comparison with trusted projects in docs/robustness.md: `python docs/make/trusted.py [--write]`.

Each input goes to each installed project that can take it, in a process of its own, and what happens is a cell of the
table. Packages that are missing have no column.
"""

import hashlib
import json
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from pages import ROOT, put_block, table

PAGE = ROOT / "docs" / "robustness.md"
SECONDS = 300
OURS = "pter_gym"
PROJECTS = (OURS, "mujoco", "gymnasium", "stable_baselines3", "safetensors")
NAMES = {"mujoco": "MuJoCo", "gymnasium": "Gymnasium", "stable_baselines3": "Stable-Baselines3"}
NO_CELL = "–"

PROMISES = """\
| Project | What it promises | How it tests that |
|---|---|---|
| [MuJoCo](https://mujoco.readthedocs.io/en/stable/XMLreference.html#option-flag-autoreset) | after a numerical \
problem the state is reset, with a warning, unless that is switched off | unit tests in C++ and Python |
| [Drake](https://drake.mit.edu/stable.html) | changes of the interface are announced three months before | unit \
tests; [builds](https://drake.mit.edu/jenkins.html) with a sanitizer and with Valgrind, after a merge and at night |
| [Gymnasium](https://gymnasium.farama.org/api/env/) | an interface; what a bad action does \
is up to each environment | `check_env`: spaces, seeds, what `step` returns |
| [Stable-Baselines3](https://stable-baselines3.readthedocs.io/en/master/guide/algos.html) | one seed gives one result \
on one platform, not across platforms or releases of PyTorch | unit tests; \
[`VecCheckNan`](https://stable-baselines3.readthedocs.io/en/master/guide/checking_nan.html) for those who ask for it |
| [safetensors](https://github.com/huggingface/safetensors#format) | nothing is executed, headers have at most \
100 MB, tensors do not overlap; no look at values | unit tests in Rust and Python; fuzzing |
| pter_gym | no number that is not finite; a typed error before anything changes; the same bits for any number of \
worlds and threads; files whole or not at all | the campaigns on this page |
"""
"""Project, what it promises, how it tests that; from the documents that are linked."""


@dataclass(frozen=True)
class Probe:
    """An input, the project that gets it, and a function that says what happens."""

    what: str
    project: str
    run: Callable[[], str]


PROBES: dict[str, Probe] = {}


def probe(what: str, project: str) -> Callable[[Callable[[], str]], Callable[[], str]]:
    """Enter a function among the probes."""

    def enter(run: Callable[[], str]) -> Callable[[], str]:
        PROBES[run.__name__] = Probe(what, project, run)
        return run

    return enter


def outcome(call: Callable[[], object], told: Callable[[Any], str]) -> str:
    """What a call does: the type of its error, or what is told of its result."""
    try:
        result = call()
    except Exception as error:  # noqa: BLE001 - any error is an answer
        return f"refused: `{type(error).__name__}`"
    return told(result)


def finite(*values: object) -> str:
    """Whether numbers are finite."""
    good = all(np.isfinite(np.asarray(value, float)).all() for value in values)
    return f"accepted; {'finite' if good else 'not finite'}"


NAN = "an action of NaN"
HUGE = "an action of 10⁹"
SHAPE = "an action with an entry too many"


def our_step(action: object) -> str:
    """One step of our environment, and whether a refused one left the state as it was."""
    import gymnasium

    import pter_gym  # noqa: F401

    env: Any = gymnasium.make("PTER/PathFollowing-v0", disable_env_checker=True).unwrapped
    env.reset(seed=0)
    before = env.batch.get_state()
    found = outcome(lambda: env.step(action), lambda result: finite(result[0], result[1]))
    after = env.batch.get_state()
    same = all(np.array_equal(after[name], before[name]) for name in before)
    return f"{found}; state {'as before' if same else 'changed'}"


@probe(NAN, OURS)
def our_nan() -> str:
    return our_step(np.full(4, np.nan, np.float32))


@probe(HUGE, OURS)
def our_huge() -> str:
    return our_step(np.full(4, 1e9, np.float32))


@probe(SHAPE, OURS)
def our_shape() -> str:
    return our_step(np.zeros(5, np.float32))


def pendulum(action: object) -> str:
    """A step of Gymnasium's Pendulum, with the wrappers that `make` adds."""
    import gymnasium

    env = gymnasium.make("Pendulum-v1")
    env.reset(seed=0)
    return outcome(lambda: env.step(np.asarray(action, np.float32)), lambda result: finite(result[0], result[1]))


@probe(NAN, "gymnasium")
def gymnasium_nan() -> str:
    return pendulum([np.nan])


@probe(HUGE, "gymnasium")
def gymnasium_huge() -> str:
    return pendulum([1e9])


@probe(SHAPE, "gymnasium")
def gymnasium_shape() -> str:
    return pendulum([0.0, 0.0])


MODEL = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" damping="0.1"/><geom type="capsule" size="0.02"
fromto="0 0 0 0 0 -0.5" {mass}/></body></worldbody><actuator><motor joint="hinge"/></actuator></mujoco>"""


def mujoco_step(change: Callable[[Any], None]) -> str:
    """Steps of a pendulum after a change of its data, with the warnings that MuJoCo counts."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(MODEL.format(mass='mass="1"'))
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_step(model, data)

    def go() -> Any:
        change(data)
        for _ in range(10):
            mujoco.mj_step(model, data)
        return data

    def told(data: Any) -> str:
        kinds = {int(kind): name.removeprefix("mjWARN_") for name, kind in mujoco.mjtWarning.__members__.items()}
        warned = [kinds[place] for place in range(len(data.warning)) if data.warning[place].number]
        reset = "; state was reset" if data.time < 10.5 * model.opt.timestep else ""
        return finite(data.qpos, data.qvel) + reset + (f"; warning {', '.join(warned)}" if warned else "")

    return outcome(go, told)


@probe(NAN, "mujoco")
def mujoco_nan() -> str:
    return mujoco_step(lambda data: data.ctrl.fill(np.nan))


@probe(HUGE, "mujoco")
def mujoco_huge() -> str:
    return mujoco_step(lambda data: data.ctrl.fill(1e9))


@probe(SHAPE, "mujoco")
def mujoco_shape() -> str:
    return mujoco_step(lambda data: setattr(data, "ctrl", [0.0, 0.0]))


def stable_step(action: object) -> str:
    """A step of Pendulum in the vector environment of Stable-Baselines3."""
    import gymnasium
    from stable_baselines3.common.vec_env import DummyVecEnv

    env = DummyVecEnv([lambda: gymnasium.make("Pendulum-v1")])
    env.seed(0)
    env.reset()
    return outcome(lambda: env.step(np.asarray(action, np.float32)), lambda result: finite(result[0], result[1]))


@probe(NAN, "stable_baselines3")
def stable_nan() -> str:
    return stable_step([[np.nan]])


@probe(HUGE, "stable_baselines3")
def stable_huge() -> str:
    return stable_step([[1e9]])


@probe(SHAPE, "stable_baselines3")
def stable_shape() -> str:
    return stable_step([[0.0, 0.0]])


STATE = "a state of infinity"


@probe(STATE, OURS)
def our_state() -> str:
    import gymnasium

    import pter_gym  # noqa: F401

    env: Any = gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=1)
    env.reset(seed=0)
    state = env.get_state()
    for part in state.values():
        if part.dtype.kind == "f" and part.size > 8:
            part.flat[0] = np.inf

    def go() -> Any:
        env.set_state(state)
        return env.step(np.zeros((1, 4), np.float32))

    return outcome(go, lambda result: finite(result[0], result[1]))


@probe(STATE, "mujoco")
def mujoco_state() -> str:
    return mujoco_step(lambda data: data.qpos.fill(np.inf))


SEED = "a seed of −1"


@probe(SEED, OURS)
def our_seed() -> str:
    import gymnasium

    import pter_gym  # noqa: F401

    env = gymnasium.make("PTER/PathFollowing-v0", disable_env_checker=True)
    return outcome(lambda: env.reset(seed=-1), lambda result: finite(result[0]))


@probe(SEED, "gymnasium")
def gymnasium_seed() -> str:
    import gymnasium

    env = gymnasium.make("Pendulum-v1")
    return outcome(lambda: env.reset(seed=-1), lambda result: finite(result[0]))


MASS = "a mass of NaN"


@probe(MASS, OURS)
def our_mass() -> str:
    from dataclasses import replace

    from pter_gym.params import BASELINE, Hand

    return outcome(lambda: replace(BASELINE, hand=Hand(mass=float("nan"))), lambda _: "accepted")


@probe(MASS, "mujoco")
def mujoco_mass() -> str:
    import mujoco

    text = MODEL.format(mass='mass="nan"')
    return outcome(lambda: mujoco.MjModel.from_xml_string(text), lambda model: finite(model.body_mass))


CODE = "a saved policy with code in it"
MARK = "executed.txt"


class Executes:
    """Pickled, it writes a file when it is read."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.write_text, (Path(MARK), "executed")


def executed(found: str) -> str:
    """What was found, and whether code was executed."""
    return f"{found}; **code executed**" if Path(MARK).exists() else f"{found}; nothing executed"


def stable_model() -> Any:
    """A small model of Stable-Baselines3."""
    from stable_baselines3 import PPO

    return PPO("MlpPolicy", "Pendulum-v1", n_steps=64, batch_size=64, n_epochs=1, seed=0, device="cpu")


@probe(CODE, "stable_baselines3")
def stable_code() -> str:
    import base64
    import zipfile

    import cloudpickle
    from stable_baselines3 import PPO

    stable_model().save("model.zip")
    with zipfile.ZipFile("model.zip") as old, zipfile.ZipFile("hostile.zip", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "data":
                data = json.loads(content)
                text = base64.b64encode(cloudpickle.dumps(Executes())).decode()
                content = json.dumps({**data, "extra": {":type:": "x", ":serialized:": text}}).encode()
            new.writestr(name, content)
    return executed(outcome(lambda: PPO.load("hostile.zip", device="cpu"), lambda _: "accepted"))


def load_ours(change: Callable[[bytes], bytes]) -> str:
    """Load our shipped policy with other weights, whose checksum is in its card."""
    from pter_gym.policies import SHIPPED, load_policy

    weights = change((SHIPPED / "ppo-standard.safetensors").read_bytes())
    card = json.loads((SHIPPED / "ppo-standard.json").read_text("utf-8"))
    card["weights_sha256"] = hashlib.sha256(weights).hexdigest()
    folder = Path("policy")
    folder.mkdir()
    (folder / "ppo-standard.json").write_text(json.dumps(card), "utf-8")
    (folder / "ppo-standard.safetensors").write_bytes(weights)
    return outcome(lambda: load_policy("policy/ppo-standard"), lambda _: "accepted")


def load_safetensors(change: Callable[[bytes], bytes]) -> str:
    """Load a small file of safetensors after a change."""
    from safetensors.numpy import load, save

    data = change(save({"a": np.ones(4, np.float32), "b": np.zeros(4, np.float32)}))
    return outcome(lambda: load(data), lambda _: "accepted")


def pickled(_: bytes) -> bytes:
    """Bytes that execute code if they are read as a pickle."""
    import pickle

    return pickle.dumps(Executes())


def short(data: bytes) -> bytes:
    """The data without the last byte."""
    return data[:-1]


def not_a_number(data: bytes) -> bytes:
    """The data with a NaN as their last number."""
    return data[:-4] + np.float32(np.nan).tobytes()


def doubled(data: bytes) -> bytes:
    """A file of safetensors whose first name is there twice."""
    length = int.from_bytes(data[:8], "little")
    header = data[8 : 8 + length].decode().strip()
    entries = json.loads(header)
    name = next(iter(entries))
    text = f"{{{json.dumps(name)}:{json.dumps(entries[name])},{header[1:]}".encode()
    return len(text).to_bytes(8, "little") + text + data[8 + length :]


@probe(CODE, OURS)
def our_code() -> str:
    return executed(load_ours(pickled))


@probe(CODE, "safetensors")
def safetensors_code() -> str:
    return executed(load_safetensors(pickled))


SHORT = "weights without their last byte"
NAN_WEIGHTS = "weights of NaN"
DOUBLED = "weights with a name twice"


@probe(SHORT, OURS)
def our_short() -> str:
    return load_ours(short)


@probe(SHORT, "safetensors")
def safetensors_short() -> str:
    return load_safetensors(short)


@probe(SHORT, "stable_baselines3")
def stable_short() -> str:
    from stable_baselines3 import PPO

    stable_model().save("model.zip")
    Path("short.zip").write_bytes(short(Path("model.zip").read_bytes()))
    return outcome(lambda: PPO.load("short.zip", device="cpu"), lambda _: "accepted")


@probe(NAN_WEIGHTS, OURS)
def our_weights() -> str:
    return load_ours(not_a_number)


@probe(NAN_WEIGHTS, "safetensors")
def safetensors_weights() -> str:
    return load_safetensors(not_a_number)


@probe(NAN_WEIGHTS, "stable_baselines3")
def stable_weights() -> str:
    import torch
    from stable_baselines3 import PPO

    model = stable_model()
    with torch.no_grad():
        next(iter(model.policy.parameters())).fill_(float("nan"))
    model.save("model.zip")
    return outcome(lambda: PPO.load("model.zip", device="cpu"), lambda _: "accepted")


@probe(DOUBLED, OURS)
def our_doubled() -> str:
    return load_ours(doubled)


@probe(DOUBLED, "safetensors")
def safetensors_doubled() -> str:
    return load_safetensors(doubled)


FULL = "a full disk while a file is replaced"


def on_full_disk(path: Path, write: Callable[[], object], most: int = 512) -> str:
    """Write over a file where no file may have more than some bytes, and tell what is left of it."""
    before = path.read_bytes()
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    found = outcome(write, lambda _: "no error")
    whole = path.exists() and path.read_bytes() == before
    return f"{found}; the earlier file is {'whole' if whole else '**lost**'}"


@probe(FULL, OURS)
def our_disk() -> str:
    from safetensors.numpy import load

    from pter_gym.policies import SHIPPED, write_policy
    from pter_gym.policies.cards import read_card

    folder = Path("policy")
    folder.mkdir()
    for ending in ("json", "md", "safetensors"):
        shutil.copy(SHIPPED / f"ppo-standard.{ending}", folder)
    card = read_card((folder / "ppo-standard.json").read_bytes(), "card")
    weights = folder / "ppo-standard.safetensors"
    tensors = load(weights.read_bytes())
    return on_full_disk(weights, lambda: write_policy(card, tensors, "", folder))


@probe(FULL, "safetensors")
def safetensors_disk() -> str:
    from safetensors.numpy import save_file

    tensors = {"a": np.ones(4096, np.float32)}
    save_file(tensors, "weights.safetensors")
    return on_full_disk(Path("weights.safetensors"), lambda: save_file(tensors, "weights.safetensors"))


@probe(FULL, "stable_baselines3")
def stable_disk() -> str:
    model = stable_model()
    model.save("model.zip")
    return on_full_disk(Path("model.zip"), lambda: model.save("model.zip"))


@probe(FULL, "mujoco")
def mujoco_disk() -> str:
    import mujoco

    model = mujoco.MjModel.from_xml_string(MODEL.format(mass='mass="1"'))
    mujoco.mj_saveModel(model, "model.mjb")
    return on_full_disk(Path("model.mjb"), lambda: mujoco.mj_saveModel(model, "model.mjb"))


THREADS = "1, 2 and 4 threads"


def alike(run: Callable[[int], bytes]) -> str:
    """Whether numbers of threads give the same bits."""
    return "same bits" if len({run(count) for count in (1, 2, 4)}) == 1 else "other bits"


@probe(THREADS, OURS)
def our_threads() -> str:
    import gymnasium

    import pter_gym  # noqa: F401

    def run(count: int) -> bytes:
        env: Any = gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=2048, num_threads=count)
        env.reset(seed=0)
        volts = np.random.default_rng(0).uniform(0.0, 1.0, (2048, 4)).astype(np.float32)
        return b"".join(part.tobytes() for _ in range(20) for part in env.step(volts)[:2])

    return alike(run)


@probe(THREADS, "mujoco")
def mujoco_threads() -> str:
    import mujoco
    from mujoco import rollout

    model = mujoco.MjModel.from_xml_string(MODEL.format(mass='mass="1"'))
    rng = np.random.default_rng(0)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start, controls = rng.normal(size=(64, size)), rng.normal(size=(64, 100, 1))

    def run(count: int) -> bytes:
        states, _ = rollout.rollout(model, [mujoco.MjData(model) for _ in range(count)], start, controls)
        return states.tobytes()

    return alike(run)


@probe(THREADS, "stable_baselines3")
def stable_threads() -> str:
    import torch

    def run(count: int) -> bytes:
        torch.set_num_threads(count)
        model = stable_model().learn(128)
        return b"".join(part.detach().numpy().tobytes() for part in model.policy.parameters())

    return alike(run)


def in_process(name: str) -> str:
    """Run a probe in a process and a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(Path(__file__).resolve()), "--only", name]
        try:
            done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=SECONDS, check=False)
        except subprocess.TimeoutExpired:
            return f"**no end in {SECONDS} s**"
    if done.returncode < 0:
        return f"**{signal.Signals(-done.returncode).name}**"
    if done.returncode:
        raise RuntimeError(f"{name}: {done.stderr}")
    return done.stdout.splitlines()[-1]


def installed(project: str) -> str | None:
    """The version of a project, if it is there."""
    try:
        return version(project.replace("_", "-"))
    except PackageNotFoundError:
        return None


def comparison(cells: dict[str, str], versions: dict[str, str]) -> str:
    """The table of inputs and projects, from what each probe said."""
    rows = []
    for what in dict.fromkeys(each.what for each in PROBES.values()):
        found = {each.project: cells[name] for name, each in PROBES.items() if each.what == what and name in cells}
        rows.append([what, *(found.get(project, NO_CELL) for project in versions)])
    header = ["Input", *(f"{NAMES.get(project, project)} {number}" for project, number in versions.items())]
    return table(header, rows, "---")


def main(only: str | None = None, *, write: bool = False) -> None:
    """Write both tables, or run one probe here."""
    if only is not None:
        print(PROBES[only].run())
        return
    versions = {project: number for project in PROJECTS if (number := installed(project))}
    cells = {name: in_process(name) for name, each in PROBES.items() if each.project in versions}
    put_block(PAGE, "trusted", f"{PROMISES}\nMeasured:\n\n{comparison(cells, versions)}", write=write)


if __name__ == "__main__":
    tyro.cli(main)
