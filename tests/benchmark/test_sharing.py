"""A policy as a folder for the hub: whole, with scores that are those of the benchmark, and read from its path."""

import json
import re
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import pter_gym
from pter_gym.benchmark import leaderboards, run_scenario
from pter_gym.benchmark.sharing import front_matter, model_card, scenario_of, share_policy
from pter_gym.policies import SHIPPED, read_policy
from pter_gym.scenarios import PACES, SCENARIOS

EPISODES = 4
NAME = "ppo-standard"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for package in ("pygame", "imageio_ffmpeg"):
        pytest.importorskip(package)
    return share_policy(NAME, tmp_path_factory.mktemp("hub") / "mine", episodes=EPISODES)


@pytest.fixture(scope="module")
def front() -> str:
    boards = leaderboards(run_scenario("standard", [NAME], fresh=0, episodes=EPISODES))
    return front_matter(NAME, SCENARIOS["standard"], boards)


@pytest.mark.slow
def test_the_folder_is_whole_and_a_policy_of_its_path(folder: Path) -> None:
    files = {path.name for path in folder.iterdir()}
    assert files == {"README.md", f"{NAME}.json", f"{NAME}.safetensors", "replay.mp4"}
    for ending in (".json", ".safetensors"):
        assert (folder / f"{NAME}{ending}").read_bytes() == (SHIPPED / f"{NAME}{ending}").read_bytes()
    env = gymnasium.make("PTER/Standard-v0")
    observation, _ = env.reset(seed=0)
    mine, shipped = (pter_gym.load_policy(policy, env)(observation) for policy in (folder, NAME))
    assert mine.tobytes() == shipped.tobytes()
    assert (folder / "replay.mp4").stat().st_size > 10_000
    assert b"ftyp" in (folder / "replay.mp4").read_bytes()[:16]


@pytest.mark.slow
def test_the_card_has_the_scores_of_the_benchmark(folder: Path) -> None:
    text = (folder / "README.md").read_text("utf-8")
    seed = int(re.findall(r"seed, (\d+), follows", text)[0])
    boards = leaderboards(run_scenario("standard", [NAME], fresh=seed, episodes=EPISODES))
    policy = read_policy(NAME)
    assert policy.card.about["scenario"] == "PTER/Standard-v0"
    assert front_matter(NAME, SCENARIOS["standard"], boards) in text
    written = (SHIPPED / f"{NAME}.md").read_text("utf-8")
    assert text.endswith(model_card(written, SCENARIOS["standard"], boards))


def test_each_score_has_its_interval(front: str) -> None:
    metrics: list[dict[str, Any]] = [json.loads(line[6:]) for line in front.splitlines() if line.startswith("    - {")]
    assert len(metrics) == 2 * len(PACES)
    for metric in metrics:
        low, high = metric["args"]["interval_95"]
        assert low <= metric["value"] <= high
        assert metric["args"]["episodes"] == EPISODES


def test_the_front_is_yaml(front: str) -> None:
    yaml = pytest.importorskip("yaml")
    found = yaml.safe_load(front.split("---\n")[1])
    assert found["license"] == "mit"
    assert found["library_name"] == "pter-gym"
    (model,) = found["model-index"]
    assert model["name"] == NAME
    assert model["results"][0]["dataset"]["type"] == "PTER/Standard-v0"


def test_the_hubs_own_library_takes_the_card(front: str) -> None:
    hub = pytest.importorskip("huggingface_hub")
    data = hub.ModelCard(f"{front}\n# {NAME}\n").data
    assert (data.license, data.library_name, data.model_name) == ("mit", "pter-gym", NAME)
    assert len(data.eval_results) == 2 * len(PACES)
    assert data.eval_results[0].metric_type == "path_error_m"


def test_a_policy_is_scored_where_it_was_trained() -> None:
    assert scenario_of("PTER/Paths-v0").name == "paths"
    assert scenario_of("all").name == scenario_of(None).name == "everything"
