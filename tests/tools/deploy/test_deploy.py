"""Policies in C and ONNX: what they do is what the policies do in Python."""

import importlib.util
import io
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import deploy as bench  # in benchmarks
import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym._physics.arm import links_at
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.rollout import evaluate, record_episode
from pter_gym.controllers import CONTROLLERS, PerClutch, Policy, bind, compiled
from pter_gym.controllers._gains import RELEASED
from pter_gym.controllers._policy import clutch_rows
from pter_gym.controllers._simple import constant
from pter_gym.errors import ParameterError, ProofError, StorageError
from pter_gym.params import BASELINE, MACHINES, Machine, find_machine
from pter_gym.paths import find_path
from pter_gym.policies import Input
from pter_gym.policies.find import DETECTOR
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN, OBS, Failure, PathFollowing, observation_layout
from pter_gym.tools.deploy import Source, source_of, write_onnx
from pter_gym.tools.deploy.functions import arctangent, cosine, encoder, sine
from pter_gym.tools.deploy.proof import MachineModel, prove
from rollouts import Acting, releasing

HERE = Path(__file__).parent
WORLDS, STEPS = 40, 250
TOP = BASELINE.clutch.voltage_max

ROUNDING = 256 * 2.0**-24 * TOP
"""Change of a voltage [V] by float32: about as many roundings as the longest sum has terms."""

OTHER_LINKS = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.6, length_b=0.4))

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")

has_zig = importlib.util.find_spec("ziglang") is not None
needs_zig = pytest.mark.skipif(not has_zig, reason="ziglang is not installed")
needs_compiler = pytest.mark.skipif(
    not (has_zig or shutil.which("cc")), reason="no C compiler is installed"
)


COMPILER = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
SANITIZED = (
    ("-fsanitize=address,undefined", "-fno-sanitize-recover=all") if shutil.which("cc") else ()
)


def built(source: Source, folder: Path, program: Path | None = None) -> Path:
    """A program made by the C compiler at hand."""
    source.write(folder)
    files = [folder / "pter.c", program or folder / "main.c"]
    options = [
        "-std=c99",
        "-O1",
        *WARNINGS,
        "-I",
        folder,
        "-nodefaultlibs",
        "-lc",
        "-o",
        folder / "program",
    ]
    subprocess.run([*COMPILER, *files, *options], check=True)
    return folder / "program"


def lines_of(rows: Any) -> str:
    """Rows of numbers as a program reads them."""
    return "".join(",".join(f"{value:.17g}" for value in row) + "\n" for row in rows.tolist())


def episodes_of(observations: Any) -> str:
    """Input of a program without force sensors: episodes (steps, worlds, entries)."""
    count = len(observation_layout(BASELINE, "torque"))
    return "".join(
        "\n" + lines_of(observations[:, world, :count]) for world in range(observations.shape[1])
    )


def said(program: Path, text: str) -> Any:
    """What a program prints, as numbers."""
    found = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    return np.loadtxt(io.StringIO(found.stdout), delimiter=",").astype(np.float32)


def ride(machines: Sequence[Any], tasks: Sequence[Any]) -> Any:
    """Observations of episodes, float32 (STEPS, worlds, entries)."""
    batch = Batch(machines, tasks, sensors="force")
    obs, _ = batch.reset(range(len(tasks)))
    policy = Acting(bind(find_policy("torque-feedback-tuned"), BASELINE, batch.layout))
    rows = [obs]
    for _ in range(STEPS - 1):
        rows.append(batch.step(policy(rows[-1]), SKIP).obs)
    return np.array(rows)


@pytest.fixture(scope="module")
def recorded() -> Any:
    """Observations of episodes; in half of them, a clutch is dead."""
    machines, tasks = zip(*find_scenario("everything").draws.pairs(WORLDS, 1), strict=True)
    dead = [(), *((Failure(clutch=clutch, torque=0.0),) for clutch in (1, 2, 3, 4))]
    failing = [dead[max(0, k % 8 - 3)] for k in range(WORLDS)]
    tasks = [replace(task, failures=each) for task, each in zip(tasks, failing, strict=True)]
    found = ride(machines, tasks)
    assert np.isfinite(found).all()
    return found, episodes_of(found)


def actions(policy: Any, observations: Any) -> Any:
    """Voltages in Python, decisions held, world after world: float32 (STEPS·worlds, 4)."""
    acting = Acting(policy)
    seen = np.ascontiguousarray(observations[..., : len(policy.layout)])
    decided = [acting(each) for each in seen[:: policy.frame_skip]]
    held = [decided[step // policy.frame_skip] for step in range(len(seen))]
    volts = np.swapaxes(held, 0, 1)
    return np.pad(volts, ((0, 0), (0, 0), (0, 4 - volts.shape[2]))).reshape(-1, 4)


def held_policy() -> Any:
    """A policy that decides at every third control step."""
    policy = find_policy("ppo-standard")
    return replace(policy, interface=replace(policy.interface, frame_skip=3))


LAWS = ("impedance", "single-dof-tuned", "residual", "single-dof-tuned+detector")
MORE_LAWS = sorted({*CONTROLLERS, *tuned_policies(), "ppo-standard"} - {*LAWS, "free", "random"})
MORE_LAWS += ["universal+detector"]
SMALLER = [
    ("torque-feedback-tuned", "float", "float"),
    ("residual", "float", "float"),
    ("ppo-standard", "double", "int8"),
    pytest.param("universal+detector", "double", "int8", marks=pytest.mark.long),
]


@needs_compiler
@pytest.mark.parametrize(
    ("name", "numbers", "weights"),
    [
        *((name, "double", "float") for name in LAWS),
        *(pytest.param(name, "double", "float", marks=pytest.mark.long) for name in MORE_LAWS),
        *SMALLER,
    ],
)
def test_a_program_gives_pythons_actions_on_ten_thousand_observations(
    name: str, numbers: Any, weights: Any, recorded: Any, tmp_path: Path
):
    source = source_of(find_policy(name), name=name, numbers=numbers, weights=weights)
    observations, text = recorded
    expected = actions(source.policy, observations)
    differ = np.abs(said(built(source, tmp_path), text) - expected).max()
    if name.endswith(DETECTOR):
        healthy = bind(find_policy(name.removesuffix(DETECTOR)), BASELINE, source.policy.layout)
        assert (expected != actions(healthy, observations)).any(), "one is named"
    assert differ == 0.0 if numbers == "double" else 0.0 < differ < ROUNDING


@needs_compiler
@pytest.mark.parametrize(
    ("policy", "machine"),
    [
        (held_policy, "baseline"),
        ("single-dof", "couplings-1-2"),
        ("single-dof-scaled", "two-brakes"),
        (partial(releasing, "universal"), "delrin_experimental"),
        ("universal", "two-brakes"),
    ],
)
def test_a_decision_is_held_and_a_law_knows_other_clutches(
    policy: Any, machine: str, recorded: Any, tmp_path: Path
):
    observations, text = recorded
    own = find_machine(machine)
    source = source_of(policy() if callable(policy) else find_policy(policy), machine=own)
    assert (said(built(source, tmp_path), text) == actions(source.policy, observations)).all()


def own(law: Any, gains: Any) -> Policy:
    """The policy of a compiled law."""
    return Policy.from_law(law, gains, BASELINE, observation_layout(BASELINE, "torque"))


@compiled
def own_law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Brake more and more, the further the tip is from the path."""
    memory[0] = 0.9 * memory[0] + abs(obs[OBS.normal_error] * scales[OBS.normal_error])
    volts = 0.0
    for k in range(20):
        volts += gains[k] * memory[0]
        if volts > 10.0:
            break
    return PerClutch(volts, volts if obs[OBS.omega_a] > 0.0 else 0.0, 0.0, 0.0)


@needs_compiler
def test_a_users_own_law_becomes_a_program(recorded: Any, tmp_path: Path):
    source = source_of(own(own_law, np.arange(20.0)))
    observations, text = recorded
    assert (said(built(source, tmp_path), text) == actions(source.policy, observations)).all()


@compiled
def changing_law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    at = memory
    if obs[0] > 0.0:
        at = memory[1:]
    return PerClutch(at[0], 0.0, 0.0, 0.0)


@compiled
def truncating_law(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(first_or(obs[0] > 0.0, memory[0]), 0.0, 0.0, 0.0)


@compiled
def first_or(first: bool, other: float) -> float:
    if first:
        return 1
    return other


@pytest.mark.parametrize(
    ("law", "what"), [(changing_law, "changing_law .* at"), (truncating_law, "first_or .* return")]
)
def test_a_law_whose_types_c_cannot_keep_is_refused(law: Any, what: str):
    with pytest.raises(ParameterError, match=what):
        source_of(own(law, np.zeros(2)))


@needs_compiler
@pytest.mark.parametrize(
    ("path", "numbers", "tolerance", "machine"),
    [
        ("line", "double", 1e-6, OTHER_LINKS),
        ("sine", "double", 1e-6, BASELINE),
        ("sine", "float", 1e-4, BASELINE),
    ],
    ids=["line", "sine", "float"],
)
def test_the_observation_is_the_simulators(
    path: str, numbers: Any, tolerance: float, machine: Machine, tmp_path: Path
):
    task = PathFollowing(path=find_path(path), pace=0.25)
    episode = record_episode(find_policy("single-dof-tuned"), machine, task, 0, nominal=machine)
    layout = observation_layout(machine, "force")
    theta = episode.telemetry[:, [*COLUMN.theta]]
    places = [layout.index(each) for each in ("omega_a", "torque_1", "force_along", "volts_1")]
    others = [
        episode.obs[:, k : k + n] * layout.scales[k : k + n]
        for k, n in zip(places, (2, 4, 2, 4), strict=True)
    ]
    program = built(
        source_of(find_policy("single-dof-tuned"), path=path, numbers=numbers, machine=machine),
        tmp_path,
        HERE / "observe.c",
    )
    found = said(program, lines_of(np.hstack([theta, *others])))
    np.testing.assert_allclose(found, episode.obs[:, : found.shape[1]], rtol=0.0, atol=tolerance)


def test_a_small_gain_or_weight_stays_small_in_float32():
    gains = np.array([1e-12, 0.0, 0.0, 0.0])
    source = source_of(own(constant, gains), numbers="float")
    assert "1e-12f" in source.files["pter.c"]


def test_elementary_functions_are_those_of_mathematics():
    for angle in np.linspace(-50.0, 50.0, 999).tolist():
        assert sine(angle) == pytest.approx(math.sin(angle), abs=2e-15)
        assert cosine(angle) == pytest.approx(math.cos(angle), abs=2e-15)
        y, x = math.sin(angle) * (1.0 + angle**2), math.cos(angle) * (1.0 + angle**2)
        assert arctangent(y, x) == pytest.approx(math.atan2(y, x), abs=1e-15)
    assert arctangent(0.0, 0.0) == 0.0
    assert encoder(12, 2, 0.1, -1.0, 0.01) == pytest.approx((0.2, 20.0))


needs_board = pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="gcc-arm-none-eabi or qemu-system-arm is not installed",
)


@needs_board
@pytest.mark.parametrize(
    ("name", "numbers", "weights"),
    [("ppo-standard", "float", "int8"), ("single-dof-tuned", "double", "float")],
)
def test_a_microcontroller_gives_pythons_voltages(name: str, numbers: Any, weights: Any):
    source = source_of(find_policy(name), name=name, numbers=numbers, weights=weights)
    task = PathFollowing(pace=0.25)
    readings, observations, _ = bench.recorded(source.policy, BASELINE, task, 0)
    found = bench.cost(source, readings[:20], observations[:20])
    rows = np.ascontiguousarray(observations[:20, None, : len(source.policy.layout)])
    memory = source.policy.start(1)
    wanted = [np.float32(source.policy.act(row, memory)[0]) for row in rows]
    differ = np.abs(found.volts - wanted).max()
    assert differ == 0.0 if numbers == "double" else differ < ROUNDING
    assert 1_000 < found.act.min() <= found.act.max() < 200_000
    assert found.flash < 30_000
    assert found.ram + found.stack < 3_000


needs_avr = pytest.mark.skipif(
    not (shutil.which("avr-gcc") and shutil.which("simavr")),
    reason="gcc-avr or simavr is not installed",
)
AVR = ("avr-gcc", "-mmcu=atmega1284p", "-std=c99", "-O2", *WARNINGS, "-I.")


@needs_avr
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "weights"), [("single-dof-tuned", "float"), ("ppo-standard", "int8")]
)
def test_a_board_of_8_bits_gives_pythons_voltages(
    name: str, weights: Any, recorded: Any, tmp_path: Path
):
    source = source_of(find_policy(name), name=name, numbers="float", weights=weights)
    source.write(tmp_path)
    rows = np.ascontiguousarray(recorded[0][:20, 0, : len(source.policy.layout)])
    text = ",\n".join(f"{{{', '.join(f'{x:.9g}' for x in row)}}}" for row in rows.tolist())
    (tmp_path / "rows.h").write_text(text)
    built_for = [*AVR, HERE / "avr.c", "pter.c", "-o", "program"]
    subprocess.run(built_for, cwd=tmp_path, check=True)
    run = ["simavr", "-m", "atmega1284p", "-f", "16000000", tmp_path / "program"]
    told = subprocess.run(run, capture_output=True, text=True, check=True)
    lines = re.findall(r"[0-9a-f]{32}", told.stdout + told.stderr)  # by simavr's version
    bits = re.findall(r"[0-9a-f]{8}", "".join(lines))
    found = np.array([int(each, 16) for each in bits], np.uint32).view(np.float32).reshape(-1, 4)
    memory = source.policy.start(1)
    wanted = [np.float32(source.policy.act(row[None], memory)[0]) for row in rows]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=ROUNDING)


@needs_compiler
@pytest.mark.parametrize(
    ("numbers", "kind", "digits", "fits"),
    [("double", "DBL", 24, False), ("float", "DBL", 24, True), ("float", "FLT", 53, False)],
)
def test_a_platform_with_other_numbers_does_not_compile(
    numbers: Any, kind: str, digits: int, fits: bool, tmp_path: Path
):
    source_of(find_policy("locked"), numbers=numbers).write(tmp_path)
    code = f"#include <float.h>\n#undef {kind}_MANT_DIG\n#define {kind}_MANT_DIG {digits}\n"
    (tmp_path / "other.c").write_text(f'{code}#include "pter.c"\n')
    made = subprocess.run(
        [*COMPILER, "-std=c99", "-c", "other.c"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (made.returncode == 0) == fits
    assert fits or f"{numbers} must have" in made.stderr


CPP = """
#include "pter.h"
int main() {
    pter_state state;
    float observation[PTER_ENTRIES] = {0}, volts[4];
    pter_reset(&state);
    pter_act(&state, observation, volts);
    return !(volts[0] >= 0);
}
"""


@needs_compiler
def test_a_program_in_cpp_links(tmp_path: Path):
    source_of(find_policy("impedance")).write(tmp_path)
    (tmp_path / "loop.cpp").write_text(CPP)
    zig = [sys.executable, "-m", "ziglang"]
    c, cpp = (["cc"], ["c++"]) if shutil.which("c++") else ([*zig, "cc"], [*zig, "c++"])
    for command in ([*c, "-std=c99", "-c", "pter.c"], [*cpp, "-Wall", "loop.cpp", "pter.o"]):
        subprocess.run(command, cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "a.out"], check=True)


BOTH = r"""
#include "pter.h"
#include "tuned.h"
#include <stdio.h>
int main(void) {
    pter_state a;
    tuned_state b;
    float observation[PTER_ENTRIES] = {0}, volts[4], others[4];
    pter_reset(&a), tuned_reset(&b);
    pter_act(&a, observation, volts), tuned_act(&b, observation, others);
    printf("%.9g,%.9g,%d,%d\n", volts[0], others[0], PTER_MEMORY, TUNED_MEMORY);
    return 0;
}
"""


@needs_compiler
def test_two_policies_are_in_one_program(tmp_path: Path):
    first, second = find_policy("ppo-standard"), find_policy("single-dof-tuned")
    other = source_of(second, name="a pter_x", prefix="tuned")
    assert sorted(other.files) == ["main.c", "tuned.c", "tuned.h"]
    other.write(tmp_path)
    (tmp_path / "both.c").write_text(BOTH)
    own = source_of(first)
    own.write(tmp_path)
    (tmp_path / "one.c").write_text(
        "".join(f'#include "{x}.c"\n' for x in ("pter", "tuned", "both"))
    )
    zeros = np.zeros((1, len(own.policy.layout)), np.float32)
    policies = (own.policy, other.policy)
    wanted = [np.float32(policy.act(zeros, policy.start(1))[0, 0]) for policy in policies]
    for files in (["both.c", "pter.c", "tuned.c"], ["one.c"]):
        subprocess.run([*COMPILER, *WARNINGS, "-std=c99", *files], cwd=tmp_path, check=True)
        assert said(tmp_path / "a.out", "")[:2].tolist() == wanted


@needs_compiler
def test_a_header_of_another_policy_does_not_compile(tmp_path: Path):
    source_of(find_policy("locked")).write(tmp_path)
    compiled = [*COMPILER, "-std=c99", "-c", "pter.c"]
    subprocess.run(compiled, cwd=tmp_path, check=True)
    other = source_of(find_policy("impedance"))
    (tmp_path / "pter.h").write_text(other.files["pter.h"])
    made = subprocess.run(compiled, cwd=tmp_path, capture_output=True, text=True)
    assert made.returncode
    assert "of another policy" in made.stderr


PATHS = r"""
#include "pter.h"
#include <stdio.h>
int main(void) {
    static pter_real few[7];
    const int counts[] = {PTER_ARCS, 1, 0};
    pter_state state;
    pter_reading r = {{2, 1}, {1, -1}, {0}, {0}};
    float observation[PTER_ENTRIES], v[4];
    for (int k = 0; k < 7; k++) {
        few[k] = pter_path_arcs[k];
    }
    pter_reset(&state);
    for (int k = 0; k < 3; k++) {
        pter_path path = {k == 0 ? pter_path_arcs : few, counts[k], (pter_real)0.25};
        state.arc = k == 1 ? PTER_ARCS - 1 : state.arc; /* as after a whole path */
        pter_observe(&state, &r, &path, observation);
        pter_act(&state, observation, v);
        printf("%d,%g,%g\n", state.arc, observation[6], v[0] + v[1] + v[2] + v[3]);
    }
    return 0;
}
"""


@needs_compiler
def test_another_path_may_have_fewer_arcs(tmp_path: Path):
    (tmp_path / "paths.c").write_text(PATHS)
    source = source_of(find_policy("single-dof-tuned"), path="sine")
    built(source, tmp_path, tmp_path / "paths.c")
    files = ["-std=c99", "-g", *SANITIZED, "-I.", "pter.c", "paths.c", "-o", "sanitized"]
    subprocess.run([*COMPILER, *files], cwd=tmp_path, check=True)
    _, one, none = said(tmp_path / "sanitized", "")
    assert one[0] == none[0] == 0
    assert np.isfinite(one).all()
    assert one[2] > 0.0
    assert np.isnan(none[1])
    assert none[2] == 0.0


COUNTS = r"""
#include "pter.h"
#include <limits.h>
#include <stdio.h>
int main(void) {
    pter_reading r = {0};
    int counts[][3] = {{65533, 3, 16}, {3, 65533, 16}, {-7, 65535, 16},
                       {INT_MAX - 3, INT_MIN + 2, 32}};
    for (int k = 0; k < 4; k++) {
        int *c = counts[k], now = pter_count(c[0], (unsigned)c[1], c[2]);
        pter_encoder(&r, 0, now, c[0], 0.125, 0);
        printf("%d,%g\n", now, r.velocity[0]);
    }
    return 0;
}
"""

EPISODES = r"""
#include "pter.h"
#include <stdio.h>
int main(void) {
    static pter_state state;
    pter_reading r = {{0}, {-1, 1}, {0}, {0}};
    pter_path path = {pter_path_arcs, PTER_ARCS, 0.25};
    float observation[PTER_ENTRIES], v[4];
    while (scanf("%lf%*1[,]%lf", r.angle, r.angle + 1) == 2) {
        if (getchar() == '!') {
            pter_reset(&state);
        }
        pter_observe(&state, &r, &path, observation);
        pter_act(&state, observation, v);
        for (int n = 0; n < PTER_ENTRIES; n++) {
            printf("%.9g,", observation[n]);
        }
        printf("%.9g,%.9g,%.9g,%.9g\n", v[0], v[1], v[2], v[3]);
    }
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("policy", [held_policy, "residual"])
def test_a_second_episode_begins_as_the_first(policy: Any, tmp_path: Path):
    (tmp_path / "episodes.c").write_text(EPISODES)
    source = source_of(policy() if callable(policy) else find_policy(policy), path="circle")
    path = find_path("circle")
    links = [links_at(BASELINE.arm, *at) for at in path.sampled(20).tolist()]
    rows = [",".join(f"{math.atan2(q.sin, q.cos):.17g}" for q in pair) for pair in links]
    once = "\n".join([f"{rows[0]}!", *rows[1:], ""])
    program = built(source, tmp_path, tmp_path / "episodes.c")
    first, second = np.split(said(program, 2 * once), 2)
    assert (first == second).all()
    assert not (first[1:] == first[:-1]).all(axis=1).any()


BAD = r"""
#include "pter.h"
#include <stdio.h>
static void step(pter_state *state, pter_reading reading) {
    pter_path path = {pter_path_arcs, PTER_ARCS, 0.25};
    float observation[PTER_ENTRIES], v[4];
    pter_observe(state, &reading, &path, observation);
    pter_act(state, observation, v);
    printf("%g,%g,%g,%g\n", v[0], v[1], v[2], v[3]);
}
int main(void) {
    const pter_real bad[] = {0.0 / 0.0, 1.0 / 0.0, -1e300};
    pter_reading good = {{2, 1}, {1, -1}, {0}, {0}};
    pter_state state;
    for (int k = -1; k < 12; k++) {
        pter_reading broken = good;
        pter_real *places[] = {broken.angle, broken.angle + 1, broken.velocity + 1,
                               broken.torque + 3, broken.force};
        pter_reset(&state);
        if (k >= 0) {
            *places[k < 6 ? k / 3 : k < 9 ? k - 4 : k % 2] = bad[k < 6 ? k % 3 : k < 9 ? 0 : 1];
            step(&state, broken);
        }
        step(&state, good);
    }
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("name", ["impedance", "ppo-standard", "residual"])
def test_a_reading_that_is_no_number_gives_no_voltage_and_leaves_no_trace(
    name: str, tmp_path: Path
):
    (tmp_path / "bad.c").write_text(BAD)
    found = said(built(source_of(find_policy(name)), tmp_path, tmp_path / "bad.c"), "")
    fresh, broken, after = found[0], found[1::2], found[2::2]
    assert (broken == 0.0).all()
    assert (after == fresh).all()
    assert fresh.any()


HELD = r"""
#include "pter.h"
#include <stdio.h>
int main(void) {
    pter_state state;
    float seen[PTER_ENTRIES] = {0}, v[4];
    const float first[] = {0.1f, 0.0f / 0.0f, 0.2f, 0.1f, 0.1f, 0.1f};
    pter_reset(&state);
    for (int k = 0; k < 6; k++) {
        for (int n = 0; n < PTER_ENTRIES; n++) {
            seen[n] = first[k];
        }
        pter_act(&state, seen, v);
        printf("%.9g,%.9g,%.9g,%.9g\n", v[0], v[1], v[2], v[3]);
    }
    return 0;
}
"""


@needs_compiler
def test_a_decision_is_made_anew_after_an_observation_that_is_no_number(tmp_path: Path):
    (tmp_path / "held.c").write_text(HELD)
    source = source_of(held_policy())
    found = said(built(source, tmp_path, tmp_path / "held.c"), "")
    rows = np.full((2, len(source.policy.layout)), [[0.1], [0.2]], np.float32)
    one, two = np.float32(source.policy.act(rows, source.policy.start(2)))
    assert found.tolist() == [each.tolist() for each in (one, 0.0 * one, two, two, two, one)]


needs_frama_c = pytest.mark.skipif(not shutil.which("frama-c"), reason="Frama-C is not installed")

FAULTS = {
    "an index one too far": (r"segment \* 7 \+ 6\]", "segment * 7 + 7]"),
    "no clamp": (r"return (\w+) < high \? \1 : high;", r"return \1;"),
    "a reading of any size": (r"IS_WITHIN\(r.theta.a, MOST_TURNED\)", "1"),
    "a state that is not begun": (r"state->memory\[k\] = 0;", "(void)k;"),
}


@needs_frama_c
@pytest.mark.long
@pytest.mark.parametrize("model", get_args(MachineModel))
@pytest.mark.parametrize(
    ("name", "numbers", "weights"),
    [
        *(
            (name, numbers, "float")
            for name in sorted(tuned_policies())
            for numbers in ("double", "float")
        ),
        ("ppo-standard", "double", "float"),
        ("ppo-standard", "float", "int8"),
    ],
)
def test_no_reading_makes_a_program_do_what_is_undefined(
    name: str,
    numbers: Any,
    weights: Any,
    model: MachineModel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    source = source_of(find_policy(name), numbers=numbers, weights=weights, prefix="own")
    source.write(tmp_path, driver=True)
    monkeypatch.chdir(tmp_path.parent)
    assert "proven for every reading" in str(prove(tmp_path.name, "own.c", model))


@needs_frama_c
@pytest.mark.long
def test_a_path_of_many_arcs_is_proven(tmp_path: Path):
    source_of(find_policy("impedance"), path="sine").write(tmp_path, driver=True)
    assert "proven for every reading" in str(prove(tmp_path))


@needs_frama_c
@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_a_program_is_found(fault: str, tmp_path: Path):
    source = source_of(find_policy("ppo-standard"))
    source.write(tmp_path, driver=True)
    program = tmp_path / "pter.c"
    text, count = re.subn(*FAULTS[fault], program.read_text("utf-8"))
    assert count
    program.write_text(text, "utf-8")
    with pytest.raises(ProofError, match="not proven"):
        prove(tmp_path)


def test_without_frama_c_the_driver_is_written_and_the_way_on_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert main(["export", "impedance", "--c", str(tmp_path), "--prove"]) == 2
    assert "frama-c -eva" in capsys.readouterr().err
    assert (tmp_path / "prove.c").is_file()


PROVER = """#!{python}
import os, pathlib, sys
driver = pathlib.Path(os.environ["PWD"]) / "prove.c"
print("25.0" if sys.argv[1] == "-version" or driver.samefile("prove.c") else "")
print(" 0 alarms generated by the analysis\\nAssertions 4 valid 0 unknown 0 invalid")
"""


@pytest.mark.skipif(os.name != "posix", reason="scripts begin otherwise")
def test_a_proof_is_made_in_a_relative_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    script = tmp_path / "frama-c"
    script.write_text(PROVER.format(python=sys.executable))
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.chdir(tmp_path)
    source_of(find_policy("locked")).write("c", driver=True)
    assert prove("c").version == "25.0"


@needs_compiler
def test_an_encoder_whose_counter_wraps_turns_on(tmp_path: Path):
    (tmp_path / "counts.c").write_text(COUNTS)
    found = said(built(source_of(find_policy("impedance")), tmp_path, tmp_path / "counts.c"), "")
    assert found[:3, 0].tolist() == [65539, -3, -1]
    assert found[:, 1].tolist() == [75.0, -75.0, 75.0, 75.0]


@pytest.mark.parametrize(
    "prefix", ["", "1st", "a-b", "a b", "é", "x" * 41, "main", "Prove", "stdint"]
)
def test_a_prefix_is_a_name_in_c(prefix: str):
    with pytest.raises(ParameterError, match="prefix"):
        source_of(find_policy("impedance"), prefix=prefix)


def test_an_export_that_fails_leaves_the_older_one_whole(tmp_path: Path):
    folder = source_of(find_policy("impedance")).write(tmp_path)
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "main.c"}
    (folder / "main.c").unlink()
    (folder / "main.c").mkdir()
    with pytest.raises(StorageError, match=r"main\.c"):
        source_of(find_policy("torque-feedback")).write(tmp_path)
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert after == before


@needs_zig
def test_a_program_that_drives_the_arm_scores_as_the_policy(tmp_path: Path):
    episodes = find_episodes("standard", "brisk").first(3)
    source = source_of(find_policy("ppo-standard"))
    with ExitStack() as stack:
        program = built(source, tmp_path)
        programs = [bench.Compiled(program, len(source.policy.layout)) for _ in range(3)]
        for each in programs:
            stack.callback(each.close)
        found = evaluate(bench.Timed(programs), episodes)
    wanted = evaluate(find_policy("ppo-standard"), episodes)
    assert all((found[name] == wanted[name]).all() for name in wanted)


def two_outputs() -> Any:
    """The residual policy's first two outputs, for an arm of two brakes."""
    policy, rows = find_policy("residual"), clutch_rows(MACHINES["two-brakes"])
    *before, (weight, bias) = policy.layers
    interface = replace(policy.interface, clutches=rows)
    return replace(
        policy, interface=interface, layers=(*before, (weight[: len(rows)], bias[: len(rows)]))
    )


@pytest.mark.parametrize(
    ("name", "machine", "numbers"),
    [
        ("ppo-standard", "baseline", "double"),
        (partial(releasing, "residual"), "baseline", "double"),
        ("residual", "baseline", "float"),
        ("universal", "two-brakes", "double"),
        (two_outputs, "two-brakes", "double"),
    ],
)
def test_onnx_gives_the_policys_actions(
    name: Any, machine: str, numbers: Any, recorded: Any, tmp_path: Path
):
    onnx = pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    policy = name() if callable(name) else find_policy(name)
    file = write_onnx(policy, tmp_path / "policy.onnx", machine=machine, numbers=numbers)
    session = runtime.InferenceSession(file)
    kinds = {each.data_type for each in onnx.load(file).graph.initializer}
    assert (onnx.TensorProto.DOUBLE in kinds) == (numbers == "double")
    tolerance = 1e-6 * TOP if numbers == "double" else ROUNDING
    layout = observation_layout(machine, "torque")
    interface = policy.for_machine(find_machine(machine)).interface
    bound, names = (
        Acting(bind(policy, machine, layout)),
        [each.name for each in session.get_inputs()],
    )
    base = bind(interface.base, machine, layout) if interface.base else None
    law, memory = base and base.law, base and base.start(WORLDS)
    assert set(names) <= {*layout.names, "base_1", "base_2", "base_3", "base_4", "earlier"}
    past: list[Any] = []
    means: list[Any] = []
    for obs in np.ascontiguousarray(recorded[0][:100, :, : len(layout)]):
        given = {each: obs[:, [layout.index(each)]] for each in layout.names}
        if law:
            volts = law.act(obs, memory, RELEASED)
            volts = np.pad(volts, ((0, 0), (0, 4 - len(interface.clutches)))).astype(np.float32)
            given |= {f"base_{k + 1}": volts[:, [k]] for k in range(4)}
        if "earlier" in names:
            given["earlier"] = np.zeros(
                (WORLDS, interface.size - len(interface.inputs)), np.float32
            )
            (now,) = session.run(["inputs"], {each: given[each] for each in names})
            past = [now, *(past or [now] * 64)]
            means = [
                mean + (now - mean) / steps
                for mean, steps in zip(means or [now], interface.averages, strict=True)
            ]
            given["earlier"] = np.concatenate(
                [*(past[delay] for delay in interface.history), *means], axis=1
            )
        (volts,) = session.run(["volts"], {each: given[each] for each in names})
        assert volts.shape == (WORLDS, len(interface.clutches))
        assert np.abs(volts - bound(obs)).max() < tolerance
    told = session.get_modelmeta().custom_metadata_map
    assert told["history"].split() == [str(each) for each in interface.history]
    nothing = {each.name: np.full((1, each.shape[1]), np.nan) for each in session.get_inputs()}
    (volts,) = session.run(["volts"], {each: x.astype(np.float32) for each, x in nothing.items()})
    assert np.isfinite(volts).all()


def unsupported() -> Any:
    """A network that sees a force, which its sensors do not measure."""
    policy = find_policy("ppo-standard")
    inputs = (Input("force_along"), *policy.interface.inputs[1:])
    return replace(policy, interface=replace(policy.interface, inputs=inputs))


@pytest.mark.parametrize(
    ("policy", "options", "message"),
    [
        ("random", {}, "policies"),
        (lambda observation: observation[..., :4], {}, "policies"),
        (unsupported, {}, "inputs"),
        ("impedance", {"weights": "int8"}, "weights"),
        ("impedance", {"numbers": "half"}, "numbers"),
        ("ppo-standard", {"machine": "two-brakes"}, "clutches"),
        ("impedance", {"path": "spiral"}, "path"),
    ],
)
def test_policies_that_c_cannot_express_are_refused(policy: Any, options: Any, message: str):
    found = (
        find_policy(policy)
        if isinstance(policy, str)
        else unsupported()
        if policy is unsupported
        else policy
    )
    with pytest.raises(ParameterError, match=message):
        source_of(found, **options)


@pytest.mark.parametrize(
    "arguments",
    [
        ("impedence", "--c", "out"),
        ("random", "--c", "out"),
        ("impedance", "--c", "out", "--onnx", "policy.onnx"),
        ("ppo-standard", "--c", "out", "--onnx", "policy.txt"),
        ("ppo-standard", "--c", "out", "--machine", "two-brakes"),
        ("ppo-standard", "--onnx", "policy.onnx", "--weights", "int8"),
        ("universal+detector", "--onnx", "policy.onnx"),
        ("universal+detector", "--fmu", "arm.fmu"),
        ("ppo-standard+detector", "--c", "out"),
        ("ppo-standard", "--onnx", "policy.onnx", "--prefix", "mine"),
        ("ppo-standard", "--onnx", "policy.onnx", "--path", "sine"),
        ("ppo-standard", "--onnx", "policy.onnx", "--out", "folder"),
        ("ppo-standard", "--numbers", "float"),
        ("ppo-standard", "--machine", "two-brakes"),
    ],
)
def test_a_refused_command_writes_nothing(
    arguments: Sequence[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    assert main(["export", *arguments]) == 2
    assert "error: " in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_writes_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "impedance", "--c", "out", "--numbers", "float"]) == 0
    assert {path.name for path in Path("out").iterdir()} == {"main.c", "pter.c", "pter.h"}
    assert "typedef float pter_real;" in Path("out/pter.h").read_text("utf-8")
