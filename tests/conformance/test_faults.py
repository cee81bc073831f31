"""Bad input moves nothing; threads, processes and interrupts leave the worlds as they should be."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import pter_gym  # noqa: F401  (registers the environment)
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.envs._vector import BYTES_OF_TELEMETRY, BYTES_PER_WORLD, PathFollowingVectorEnv
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, Arm, Clutch, Hand, Machine, TorqueCurve
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing, RewardWeights, Starts

ID = "pter_gym:PTER/PathFollowing-v0"
TASK = PathFollowing(start_offset=0.01, hand=MultiSineHand(random_phases=True))
LARGE = 10_000
THREADED = 2000


def make(count: int, **options: Any) -> PathFollowingVectorEnv:
    """A vector environment that has made a few steps."""
    env = PathFollowingVectorEnv(
        count,
        task=TASK,
        action_unit="volt",
        **{"max_episode_steps": 40, "num_threads": 2, **options},
    )
    env.reset(seed=0)
    for row in actions(count, 3):
        env.step(row)
    return env


def actions(count: int, steps: int) -> np.ndarray:
    """Random voltages, most of them zero."""
    drawn = np.random.default_rng(5).random((steps, count, 8), np.float32)
    return 24.0 * drawn[..., :4] * (drawn[..., 4:] < 0.4)


def same(one: dict[str, np.ndarray], two: dict[str, np.ndarray]) -> bool:
    """Whether two states hold the same bits."""
    return one.keys() == two.keys() and all(
        one[name].tobytes() == two[name].tobytes() for name in one
    )


def digest(env: Any, steps: int = 40) -> bytes:
    """All that some steps return, and the state after them."""
    parts: list[bytes] = []
    for row in actions(env.num_envs, steps):
        *arrays, infos = env.step(row)
        parts += [np.asarray(array).tobytes() for array in arrays]
        parts.append(infos["telemetry"].tobytes())
    return b"".join(parts)


GOOD_ACTIONS: dict[str, Callable[[np.ndarray], Any]] = {
    "double": lambda rows: rows.astype(np.float64),
    "big-endian": lambda rows: rows.astype(">f4"),
    "Fortran order": np.asfortranarray,
    "columns of a wider array": lambda rows: np.pad(rows, ((0, 0), (1, 2)))[:, 1:5],
    "a list": lambda rows: rows.tolist(),
    "read-only": lambda rows: np.frombuffer(rows.tobytes(), np.float32).reshape(rows.shape),
}


@pytest.mark.parametrize("form", GOOD_ACTIONS.values(), ids=GOOD_ACTIONS)
def test_actions_in_any_layout_give_the_same_bits_and_are_only_read(
    form: Callable[[np.ndarray], Any],
) -> None:
    plain, other = make(100), make(100)
    for row in actions(100, 20):
        given = form(row)
        kept = np.array(given)
        assert plain.step(row)[0].tobytes() == other.step(given)[0].tobytes()
        assert np.array(given).tobytes() == kept.tobytes()
    assert same(plain.get_state(), other.get_state())


ONES = np.ones((100, 4), np.float32)

BAD_ACTIONS: dict[str, Any] = {
    "one world less": ONES[:-1],
    "one clutch more": np.ones((100, 5), np.float32),
    "one more axis": ONES[None],
    "for one world": ONES[0],
    "nothing": None,
    "text": ONES.astype(str),
    "booleans": ONES.astype(bool),
    "complex": ONES.astype(complex),
    "ragged": [[1.0] * 4] * 99 + [[1.0]],
    "a dict": {"volts": ONES},
}


@pytest.mark.parametrize("wrong", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_actions_of_a_wrong_shape_or_type_are_refused_and_nothing_moves(wrong: Any) -> None:
    env = make(100)
    before = env.get_state()
    with pytest.raises(ActionError, match="action"):
        env.step(wrong)
    assert same(before, env.get_state())


@pytest.mark.agents
def test_tensors() -> None:
    torch = pytest.importorskip("torch")
    plain, other = make(100), make(100)
    for row in actions(100, 10):
        assert plain.step(row)[0].tobytes() == other.step(torch.from_numpy(row))[0].tobytes()
    before = other.get_state()
    ones = torch.ones(100, 4)
    for wrong in (
        ones.requires_grad_(),
        torch.ones(100, 4, device="meta"),
        torch.ones(100, 4, dtype=torch.bfloat16),
    ):
        with pytest.raises(ActionError, match="action"):
            other.step(wrong)
    assert same(before, other.get_state())


@pytest.mark.parametrize(
    ("value", "mode"),
    [(np.nan, mode) for mode in AutoresetMode]
    + [(value, AutoresetMode.SAME_STEP) for value in (np.inf, -np.inf, -0.01, 24.01)],
)
def test_one_bad_number_among_ten_thousand_worlds_is_named_and_nothing_moves(
    value: float, mode: AutoresetMode
) -> None:
    env = make(LARGE, autoreset_mode=mode, max_episode_steps=None, telemetry=False)
    before = env.get_state()
    rows = actions(LARGE, 1)[0]
    wrong = rows.copy()
    wrong[4711, 2] = value
    wrong[4800:] = np.nan
    with pytest.raises(ActionError, match="world 4711"):
        env.step(wrong)
    assert same(before, env.get_state())
    untouched = make(LARGE, autoreset_mode=mode, max_episode_steps=None, telemetry=False)
    assert env.step(rows)[0].tobytes() == untouched.step(rows)[0].tobytes()


@pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("count", [3, THREADED])
def test_worlds_that_were_never_reset_are_named(count: int, mode: AutoresetMode) -> None:
    env = PathFollowingVectorEnv(count, autoreset_mode=mode)
    rows = np.ones((count, 4), np.float32)
    with pytest.raises(ResetNeededError, match="world 0 "):
        env.step(rows)
    mask = np.arange(count) != 2
    env.reset(seed=0, options={"reset_mask": mask})
    before = env.get_state()
    with pytest.raises(ResetNeededError, match="world 2 "):
        env.step(rows)
    assert same(before, env.get_state())
    env.reset(options={"reset_mask": ~mask})
    env.step(rows)


def test_a_world_that_has_ended_is_named_where_nothing_resets_it() -> None:
    env = make(THREADED, autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=None)
    ended = np.zeros(THREADED, bool)
    rows = np.zeros((THREADED, 4), np.float32)
    while not ended.any():
        _, _, ended, _, _ = env.step(rows)
    before = env.get_state()
    with pytest.raises(ResetNeededError, match=f"world {ended.argmax()} "):
        env.step(rows)
    assert same(before, env.get_state())


BAD_RESETS: dict[str, tuple[str, dict[str, Any]]] = {
    "a negative seed": ("seed", {"seed": -1}),
    "a fraction": ("seed", {"seed": 1.5}),
    "text": ("seed", {"seed": "one"}),
    "a flag": ("seed", {"seed": True}),
    "too large": ("seed", {"seed": 2**64 - 3}),
    "too few seeds": ("seeds", {"seed": [1, 2]}),
    "a negative seed among others": ("seed", {"seed": [1, 2, 3, 4, -5, 6, 7]}),
    "an unknown option": ("speed", {"options": {"speed": 1.0}}),
    "a list for a mask": ("reset_mask", {"options": {"reset_mask": [True] * 7}}),
    "a mask of numbers": ("reset_mask", {"options": {"reset_mask": np.ones(7)}}),
    "a short mask": ("reset_mask", {"options": {"reset_mask": np.ones(6, bool)}}),
    "an empty mask": ("reset_mask", {"options": {"reset_mask": np.zeros(7, bool)}}),
}


@pytest.mark.parametrize(("field", "arguments"), BAD_RESETS.values(), ids=BAD_RESETS)
def test_a_bad_reset_is_refused_and_nothing_changes(field: str, arguments: dict[str, Any]) -> None:
    env = make(7)
    before = env.get_state()
    with pytest.raises(ParameterError, match=field):
        env.reset(**arguments)
    assert same(before, env.get_state())


BAD_KEYWORDS: dict[str, dict[str, Any]] = {
    "num_envs": {"num_envs": 0},
    "num_threads": {"num_threads": 0},
    "max_episode_steps": {"max_episode_steps": 0},
    "autoreset_mode": {"autoreset_mode": "later"},
    "num_worlds": {"num_envs": 3, "machine": ["baseline"] * 2},
    "render_mode": {"render_mode": "human"},
}


@pytest.mark.parametrize(("field", "keywords"), BAD_KEYWORDS.items(), ids=BAD_KEYWORDS)
def test_a_bad_keyword_is_named(field: str, keywords: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=field):
        PathFollowingVectorEnv(**{"num_envs": 2, **keywords})


def test_worlds_beyond_the_memory_are_refused_and_the_estimate_is_an_upper_bound() -> None:
    with pytest.raises(ParameterError, match="num_envs"):
        PathFollowingVectorEnv(10**10)
    make(8)
    tracemalloc.start()
    try:
        options: dict[str, Any] = {
            "sensors": "force",
            "max_episode_steps": 2,
            "autoreset_mode": "SAME_STEP",
        }
        env = PathFollowingVectorEnv(LARGE, **options)
        returned: Any = env.reset(seed=0)
        for _ in range(4):
            # the last returns stay while the next are made
            returned = env.step(np.zeros((LARGE, 4), np.float32))
        assert tracemalloc.get_traced_memory()[1] / LARGE < BYTES_PER_WORLD + BYTES_OF_TELEMETRY
    finally:
        tracemalloc.stop()
    assert len(returned) == 5


def test_a_closed_environment_says_so() -> None:
    env = make(THREADED)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.step(np.zeros((THREADED, 4), np.float32))
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.reset()


def test_threads_end_with_their_environment() -> None:
    make(THREADED).close()  # whatever there is to compile is compiled
    before = set(threading.enumerate())
    env = make(THREADED, num_threads=4)
    new = [
        thread for thread in set(threading.enumerate()) - before if thread.name.startswith("pter_")
    ]
    assert 1 <= len(new) <= 3
    env.close()
    for thread in new:
        thread.join(10.0)
    assert not any(thread.is_alive() for thread in new)


def test_two_engines_in_two_threads() -> None:
    expected = digest(make(THREADED))
    found: list[bytes] = []
    envs = [make(THREADED) for _ in range(2)]
    threads = [threading.Thread(target=lambda env=env: found.append(digest(env))) for env in envs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 2


forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
# from Python 3.12 on, a fork of a process with several threads warns
quietly = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


def _send_digest(env: Any, pipe: Any) -> None:
    pipe.send(digest(env))


@forks
@quietly
def test_a_forked_child_can_use_its_parents_threaded_engine() -> None:
    env = make(THREADED)
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    child = context.Process(target=_send_digest, args=(env, theirs))
    child.start()
    expected = digest(env)
    assert ours.poll(60.0), "the child hangs"
    assert ours.recv() == expected
    child.join(60.0)
    assert child.exitcode == 0


START_METHODS = [pytest.param("fork", marks=[forks, quietly]), "spawn"]


@pytest.mark.parametrize("method", START_METHODS)
def test_gymnasiums_processes_after_the_parent_has_used_threads(method: str) -> None:
    parent = make(THREADED)
    options: dict[str, Any] = {"task": TASK, "action_unit": "volt", "max_episode_steps": 40}
    one = partial(gymnasium.make, ID, **options)
    count = 2 if method == "fork" else 1  # each imports all again
    theirs = gymnasium.vector.AsyncVectorEnv([one] * count, context=method)
    ours = PathFollowingVectorEnv(count, **options)
    try:
        assert theirs.reset(seed=3)[0].tobytes() == ours.reset(seed=3)[0].tobytes()
        for row in actions(count, 60):
            for mine, other in zip(ours.step(row)[:4], theirs.step(row)[:4], strict=True):
                assert mine.tobytes() == np.asarray(other).tobytes()
    finally:
        theirs.close()
    parent.step(actions(THREADED, 1)[0])


INTERRUPTED = """
import os, signal, sys, threading, time
import numpy as np
from pter_gym.envs._vector import PathFollowingVectorEnv

def make():
    env = PathFollowingVectorEnv(
        count, action_unit="volt", max_episode_steps=50, num_threads=3
    )
    env.reset(seed=0)
    return env

def bits(env):
    return [part.tobytes() for part in env.get_state().values()]

signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
count, rng = int(sys.argv[1]), np.random.default_rng(0)
row = np.full((count, 4), 2.0, np.float32)
env, reference = make(), make()
interrupts = 0
for _ in range(40):
    timer = threading.Timer(rng.uniform(0.001, 0.02), os.kill, (os.getpid(), signal.SIGINT))
    done = 0
    try:
        timer.start()
        latest = time.monotonic() + 2.0  # Python drops an interrupt within its own callback
        while time.monotonic() < latest:
            env.step(row)
            done += 1
    except KeyboardInterrupt:
        interrupts += 1
    for _ in range(done):
        reference.step(row)
    if bits(env) != bits(reference):
        reference.step(row)
    assert bits(env) == bits(reference), "a step was left half done"
env.close()
print(interrupts)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
@pytest.mark.parametrize("count", [64, THREADED])
def test_an_interrupted_step_is_done_or_not_begun(count: int) -> None:
    found = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(count)], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert int(found.stdout) >= 20, "hardly an interrupt arrived"


INTERRUPTED_IMPORT = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Interrupt())
sys.argv[0] = "/usr/bin/pter"
from pter_gym._commands.main import main
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
@pytest.mark.parametrize("module", ["gymnasium", "tyro"])
def test_an_interrupt_while_the_command_imports_is_silent(module: str) -> None:
    command = [sys.executable, "-c", INTERRUPTED_IMPORT, module]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout, found.stderr) == (-signal.SIGINT, "", "")


BAD_SINGLE_ACTIONS: dict[str, Any] = {
    "nan": np.array([1.0, np.nan, 1.0, 1.0], np.float32),
    "eight ulp too large": np.array(
        [1.0, 1.0, 1.0, 24.0 + 8 * np.spacing(np.float32(24.0))], np.float32
    ),
    "two rows": np.ones((2, 4), np.float32),
    "nothing": None,
}


@pytest.mark.parametrize("action", BAD_SINGLE_ACTIONS.values(), ids=BAD_SINGLE_ACTIONS)
def test_a_bad_action_of_one_world_is_refused_and_nothing_moves(action: Any) -> None:
    env: Any = gymnasium.make(ID, action_unit="volt").unwrapped
    env.reset(seed=0)
    env.step(np.full(4, 5.0, np.float32))
    before = env.batch.get_state()
    with pytest.raises(ActionError, match="action"):
        env.step(action)
    assert same(before, env.batch.get_state())


def test_step_before_reset_and_after_the_end() -> None:
    env: Any = gymnasium.make(ID).unwrapped
    free = -np.ones(4, np.float32)
    with pytest.raises(ResetNeededError):
        env.step(free)
    env.reset(seed=0)
    while not env.step(free)[2]:
        pass
    before = env.batch.get_state()
    with pytest.raises(ResetNeededError):
        env.step(free)
    assert same(before, env.batch.get_state())


@pytest.mark.parametrize("options", [5, 0, {"speed": 1.0}])
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_options_of_another_kind_are_refused(options: Any, make: Any) -> None:
    with pytest.raises(ParameterError, match="options"):
        make(ID).reset(seed=0, options=options)


@pytest.mark.parametrize("seed", [-1, 1.5, True, 2**64])
def test_a_bad_seed_is_refused(seed: Any) -> None:
    with pytest.raises(ParameterError, match="seed"):
        gymnasium.make(ID).reset(seed=seed)


def _clutch(**changes: Any) -> Clutch:
    return replace(BASELINE.clutch, **changes)


BAD_PARAMETERS: dict[str, Any] = {
    "length_a": lambda: Arm(length_a=0.0),
    "length_b": lambda: Arm(length_b=float("nan")),
    "inertia_a": lambda: Arm(inertia_a=-1.0),
    "inertia_b": lambda: Arm(inertia_b="heavy"),  # pyright: ignore[reportArgumentType]
    "coupling": lambda: Arm(inertia_a=1.0, inertia_b=1.0, coupling=1.0),
    "slope": lambda: TorqueCurve(slope=0.0, knee=1.0, curvature=0.0),
    "knee": lambda: TorqueCurve(slope=1.0, knee=-1.0, curvature=0.0),
    "curvature": lambda: TorqueCurve(slope=1.0, knee=1.0, curvature=float("inf")),
    "dynamic": lambda: _clutch(dynamic=TorqueCurve(slope=1.0, knee=0.0, curvature=-0.1)),
    "breakaway": lambda: _clutch(breakaway=3.0),
    "time_constant": lambda: _clutch(time_constant=0.0),
    "voltage_max": lambda: _clutch(voltage_max=-24.0),
    "lag": lambda: _clutch(lag="pressure"),
    "mass": lambda: Hand(mass=-1.0),
    "damping": lambda: Hand(damping=float("nan")),
    "hand.stiffness": lambda: replace(BASELINE, hand=Hand(stiffness=1e6)),
    "slip_threshold": lambda: replace(BASELINE, slip_threshold=0.0),
    "substep": lambda: replace(BASELINE, substep=0.0),
    "arm": lambda: Machine(arm=None, clutch=BASELINE.clutch),  # pyright: ignore[reportArgumentType]
    "length": lambda: Line(length=0.0),
    "direction": lambda: Line(direction=float("inf")),
    "pace": lambda: PathFollowing(pace=0.0),
    "control_period": lambda: PathFollowing(control_period=-0.01),
    "error_max": lambda: PathFollowing(error_max=0.0),
    "singularity_margin": lambda: PathFollowing(singularity_margin=1.0),
    "start_offset": lambda: PathFollowing(start_offset=0.3),
    "arrival": lambda: PathFollowing(arrival=0.0),
    "tracking": lambda: RewardWeights(tracking=-1.0),
    "gripped": lambda: Starts(moving=0.6, gripped=0.5),
    "starts": lambda: PathFollowing(starts="path"),  # pyright: ignore[reportArgumentType]
    "path": lambda: PathFollowing(path="line"),  # pyright: ignore[reportArgumentType]
}


@pytest.mark.parametrize(("field", "build"), BAD_PARAMETERS.items(), ids=BAD_PARAMETERS)
def test_a_bad_parameter_is_named(field: str, build: Any) -> None:
    with pytest.raises(ParameterError, match=rf"\.{field}\b"):
        build()


def test_conflicts_of_machine_and_task_are_refused() -> None:
    reach = BASELINE.arm.length_a + BASELINE.arm.length_b
    with pytest.raises(ParameterError, match="control_period"):
        Batch(replace(BASELINE, substep=1e-6), PathFollowing(control_period=0.02))
    with pytest.raises(ParameterError, match="path"):
        Batch(BASELINE, PathFollowing(path=Line(x=0.0, y=1.01 * reach, length=0.01)))
    with pytest.raises(ParameterError, match="path"):
        Batch(BASELINE, PathFollowing(path=Line(x=0.0, y=0.997 * reach, length=0.01)))
    with pytest.raises(ParameterError, match="start_offset"):
        Batch(BASELINE, PathFollowing(start_offset=0.03))
    small = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.035, length_b=0.05))
    beside = PathFollowing(path=Line(x=0.0, y=0.025, length=0.005), start_offset=0.05)
    with pytest.raises(ParameterError, match="start_offset"):  # starts on both sides of the base
        Batch(small, beside)
    Batch(small, replace(beside, start_offset=0.005))
    even = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.5, length_b=0.5))
    with pytest.raises(ParameterError, match="path"):  # for some millimetres, at the base
        Batch(
            even, PathFollowing(path=Line(x=-0.8965, y=5e-4, length=1.8), singularity_margin=0.004)
        )
    with pytest.raises(ParameterError, match=r"hand\.stiffness"):
        Batch(replace(BASELINE, hand=Hand(stiffness=100.0)), PathFollowing())
    with pytest.raises(ParameterError, match="substep"):
        Batch([BASELINE, replace(BASELINE, substep=0.0005)], PathFollowing())
    with pytest.raises(ParameterError, match="num_worlds"):
        Batch([], PathFollowing())


BAD_ARGUMENTS: dict[str, tuple[str, Any]] = {
    "starts": ("Standard", "anywhere"),
    "pace": ("Standard", "fast"),
    "error_max": ("Standard", -1.0),
    "reward": ("Standard", [3]),
    "context_seed": ("Standard", -1),
    "truncation_error": ("Standard", 0.0),
    "scenario": ("PathFollowing", 1),
    "contexts": ("PathFollowing", 5),
    "task": ("PathFollowing", "circle"),
    "machine": ("PathFollowing", 3),
    "frame_skip": ("PathFollowing", 2.5),
}


@pytest.mark.parametrize(("field", "given"), BAD_ARGUMENTS.items(), ids=BAD_ARGUMENTS)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_wrong_argument_is_named_as_the_user_wrote_it(
    make: Any, field: str, given: tuple[str, Any]
) -> None:
    with pytest.raises(ParameterError, match=field):
        make(f"PTER/{given[0]}-v0", **{field: given[1]})


def test_a_state_of_other_machines_is_refused() -> None:
    """A state says where a world's constants begin, and must not point elsewhere."""
    batch = Batch([BASELINE, replace(BASELINE, clutch_scale=(0.9,) * 4)], PathFollowing())
    batch.reset([0, 1])
    state = batch.get_state()
    for row, value in (
        (ROW.context_at, 1e9),
        (ROW.foot.segment, 7.0),
        (ROW.step, -1.0),
        (ROW.step, np.nan),
    ):
        broken = {**state, "worlds": state["worlds"].copy()}
        broken["worlds"][0, row, 0] = value
        with pytest.raises(ParameterError, match=r"state\['worlds'\]"):
            batch.set_state(broken)
    for name in ("worlds", "words", "seeded"):
        for wrong in (None, "text", state[name][:-1], state[name].astype(np.float32)):
            with pytest.raises(ParameterError, match=name):
                batch.set_state({**state, name: wrong})
    assert same(state, batch.get_state())
    batch.set_state(state)
