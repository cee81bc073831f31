"""The WebAssembly module: that of the present sources, and the same bits as the native kernels."""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import web_module

from pter_gym._engine.world import World
from pter_gym.benchmark.policies import find_policy
from pter_gym.controllers import CONTROLLERS
from pter_gym.hands import read_forces
from pter_gym.params import BASELINE
from pter_gym.policies._files import SHIPPED
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import TELEMETRY
from pter_gym.tools.palette import PICTURE
from pter_gym.tools.web.site import MODULE, PAGES, TABLES
from pter_gym.tools.web.tables import PATHS, pages_batch, policies_of_the_paper
from rollouts import Acting

HERE = Path(__file__).parent

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
needs_zig = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed"
)


def node(script: str, *arguments: object) -> Any:
    """What a script prints as JSON."""
    # Node 20 was seen to wait for its own threads for ever while it compiled WebAssembly
    command = ["node", "--single-threaded", str(HERE / script), str(PAGES), *map(str, arguments)]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout)


def native(*arguments: object) -> str:
    """What ``native.py`` prints."""
    command = [sys.executable, str(HERE / "native.py"), *map(str, arguments)]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    return found.stdout


@pytest.fixture(scope="module")
def functions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The module's mathematical functions as a library of this computer."""
    path = tmp_path_factory.mktemp("functions") / "functions.so"
    web_module.native_functions(path)
    return path


@pytest.fixture(scope="module")
def recorded() -> Any:
    """Observations of an episode, and of the beginning of a second one: float32 (N, entries)."""
    batch = pages_batch()
    policy = Acting(find_policy("impedance-tuned").bind(BASELINE, batch.layout))
    rows: list[Any] = []
    for seed in (0, 1):
        obs, _ = batch.reset([seed])
        for _ in range(150):
            rows.append(obs[0])
            obs = batch.step(policy(obs)).obs
    return np.array(rows)


@pytest.fixture(scope="module")
def page(recorded: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What ``wrapper.mjs`` tells."""
    file = tmp_path_factory.mktemp("page") / "observations"
    recorded.tofile(file)
    return node("wrapper.mjs", SHIPPED, file)


@pytest.mark.smoke
def test_the_module_is_that_of_the_present_sources() -> None:
    text = TABLES.read_text("utf-8")
    parts = json.loads(text)["parts"]
    assert text == web_module.as_text(MODULE.read_bytes(), parts), (
        "a source of the module of `pter play` changed: run `python docs/make/web_module.py` (half "
        "a minute; needs ziglang, of the extra `test`), and commit pter_gym/tools/web/static"
    )


def test_the_page_has_the_colours_of_the_pictures() -> None:
    light = (PAGES / "style.css").read_text("utf-8").partition("}")[0]
    assert dict(re.findall(r"--([\w-]+): (#\w+);", light)).items() >= PICTURE.items()


def test_the_module_is_small_and_has_no_local_paths() -> None:
    data = MODULE.read_bytes()
    assert data[:4] == b"\0asm"
    assert str(Path.home()).encode() not in data
    assert b"pter_gym" not in data
    assert sum(len(file.read_bytes()) for file in PAGES.iterdir()) < 260_000


@pytest.mark.long
@needs_zig
def test_the_module_is_made_again_byte_for_byte(tmp_path: Path) -> None:
    subprocess.run([sys.executable, web_module.__file__, str(tmp_path)], check=True)
    assert (tmp_path / MODULE.name).read_bytes() == MODULE.read_bytes()


def compared(functions: Path, folder: Path, steps: int) -> Any:
    native(functions, "worlds", folder, steps)
    return node("replay.mjs", folder)


@pytest.mark.slow
@needs_node
@needs_zig
def test_worlds_of_all_scenarios_have_the_bits_of_the_native_ones(
    functions: Path, tmp_path: Path
) -> None:
    """State, observation, reward, flags and telemetry at each step, and the laws' voltages."""
    found = compared(functions, tmp_path, 2500)
    assert found["different"] == []
    assert found["steps"] == 2500 * 8 * len(SCENARIOS) >= 100_000
    assert found["episodes"] > 1000


@pytest.mark.long
@needs_node
@needs_zig
def test_ten_million_steps_have_the_bits_of_the_native_ones(
    functions: Path, tmp_path: Path
) -> None:
    found = compared(functions, tmp_path, 250_000)
    assert found["different"] == []
    assert found["steps"] >= 10_000_000


@pytest.mark.slow
@needs_node
@needs_zig
def test_python_repeats_a_trial_of_a_page(page: Any, functions: Path, tmp_path: Path) -> None:
    """Forces go through the CSV file; observations, rewards and telemetry have the same bits."""
    trial = page["trial"]
    assert len(trial["rows"]) > 100
    file = tmp_path / "trial.json"
    file.write_text(json.dumps(trial))
    assert json.loads(native(functions, "trial", file)) == []


@needs_node
def test_forces_are_written_as_a_recording_is_read(page: Any, tmp_path: Path) -> None:
    file = tmp_path / "trial.csv"
    file.write_text(page["trial"]["csv"])
    hand = read_forces(file)
    assert hand.along == tuple(page["trial"]["trial"]["along"])
    assert hand.across == tuple(page["trial"]["trial"]["across"])
    assert max(map(abs, hand.along)) > 10.0
    assert max(np.hypot(hand.along, hand.across)) <= 60.0 + 1e-9, "the limit of the spring"


@needs_node
@pytest.mark.parametrize("name", [*CONTROLLERS, *tuned_policies(), *policies_of_the_paper()])
def test_policies_answer_as_in_python(name: str, page: Any, recorded: Any) -> None:
    """The module runs the same compiled laws and networks, with the same bits."""
    layout = pages_batch().layout
    for scenario in ("standard",) if name in policies_of_the_paper() else ("standard", "paths"):
        acting = Acting(find_policy(name, scenario=scenario).bind(BASELINE, layout))
        expected = [acting(row[None])[0].tolist() for row in recorded]
        assert page["answers"][f"{name}, {scenario}"] == expected


@needs_node
@pytest.mark.parametrize("name", policies_of_the_paper())
def test_networks_hold_their_decisions(name: str, page: Any) -> None:
    answers = page["answers"][f"{name}, standard"]
    held = np.array(page["answers"][f"{name}, held"]["held"])
    assert np.ptp(answers, axis=0).min() > 1.0
    assert page["answers"][f"{name}, held"]["decisions"] == -(-len(answers) // 3)
    np.testing.assert_array_equal(held, np.repeat(held[::3], 3, axis=0)[: len(held)])
    np.testing.assert_array_equal(held[0], answers[0])


@needs_node
@pytest.mark.parametrize(
    ("mistake", "kind", "told"),
    [
        ("early", "ResetNeededError", "reset"),
        ("short", "ActionError", "volts"),
        ("none", "ActionError", "volts"),
        ("nan", "ActionError", "volts"),
        ("high", "ActionError", "volts"),
        ("low", "ActionError", "volts"),
        ("force", "ParameterError", "force"),
        ("pull", "ParameterError", "force"),
        ("seed", "ParameterError", "seed"),
        ("machine", "ParameterError", "delrin_experimental"),
        ("path", "ParameterError", "sine"),
        ("hand", "ParameterError", "hand"),
        ("pace", "ParameterError", "pace"),
        ("law", "ParameterError", "torque-feedback"),
    ],
)
def test_mistakes_are_refused(mistake: str, kind: str, told: str, page: Any) -> None:
    assert page["refusals"]["unchanged"]
    found_kind, message = page["refusals"]["found"][mistake]
    assert found_kind == kind
    assert told in message


@needs_node
def test_seeds_decide_the_episodes(page: Any) -> None:
    first, following, again, again_following, other = page["seeds"]
    assert first == again
    assert following == again_following
    assert first != other
    assert first != following


@needs_node
def test_no_clutch_gives_energy_in_a_minute_of_dragging(page: Any) -> None:
    found = page["dragging"]
    assert found["steps"] == 6000
    assert found["episodes"] > 5
    assert found["power"] <= 1e-12
    assert found["dissipated"] >= -1e-12


@needs_node
def test_points_of_a_path_are_those_of_python(page: Any) -> None:
    np.testing.assert_allclose(page["points"], PATHS["circle"].sampled(9), atol=1e-12)


@needs_node
def test_numbers_have_the_names_of_the_declarations(page: Any) -> None:
    names = page["names"]
    assert names["seen"] == list(pages_batch().layout.names)
    assert names["telemetry"] == list(TELEMETRY.names)
    assert names["state"] == list(World._fields)
