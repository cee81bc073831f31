"""A policy as a folder for the hub: whole, with scores that are those of the benchmark, and read from its path."""

from pathlib import Path

import gymnasium
import pytest

import pter_gym
from pter_agents import sharing
from pter_agents.sharing import model_card, scenario_of, share_policy
from pter_gym.benchmark import leaderboards, run_scenario
from pter_gym.policies import SHIPPED
from pter_gym.scenarios import PACES, SCENARIOS

EPISODES = 4
NAME = "ppo-standard"


def card(fresh: int | str, text: str) -> str:
    boards = leaderboards(run_scenario("standard", [NAME], fresh=fresh, episodes=EPISODES))
    return model_card(NAME, text, SCENARIOS["standard"], boards)


@pytest.mark.slow
def test_the_folder_is_whole_and_a_policy_of_its_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "time_limit", lambda _: 20)  # of the film
    for package in ("pygame", "imageio_ffmpeg"):
        pytest.importorskip(package)
    folder = share_policy(NAME, tmp_path / "mine", episodes=EPISODES)
    files = {path.name for path in folder.iterdir()}
    assert files == {"README.md", f"{NAME}.json", f"{NAME}.safetensors", "replay.mp4"}
    for ending in (".json", ".safetensors"):
        assert (folder / f"{NAME}{ending}").read_bytes() == (SHIPPED / f"{NAME}{ending}").read_bytes()
    env = gymnasium.make("PTER/Standard-v0", frame_skip=1)
    observation, _ = env.reset(seed=0)
    mine, shipped = (pter_gym.load_policy(policy, env)(observation) for policy in (folder, NAME))
    assert mine.tobytes() == shipped.tobytes()
    assert (folder / "replay.mp4").stat().st_size > 1000
    assert b"ftyp" in (folder / "replay.mp4").read_bytes()[:16]
    text = (folder / "README.md").read_text("utf-8")
    assert text == card("derived", (SHIPPED / f"{NAME}.md").read_text("utf-8"))


def test_the_hub_finds_license_and_scores_in_the_front_of_the_card() -> None:
    yaml = pytest.importorskip("yaml")
    found = yaml.safe_load(card(0, f"# {NAME}\n").split("---\n")[1])
    assert (found["license"], found["library_name"]) == ("mit", "pter-gym")
    (model,) = found["model-index"]
    (result,) = model["results"]
    assert (model["name"], result["dataset"]["type"]) == (NAME, "PTER/Standard-v0")
    assert len(result["metrics"]) == 2 * len(PACES)
    for metric in result["metrics"]:
        low, high = metric["args"]["interval_95"]
        assert low <= metric["value"] <= high


def test_a_policy_is_scored_where_it_was_trained() -> None:
    assert scenario_of("PTER/Paths-v0").name == "paths"
    assert scenario_of("all").name == scenario_of(None).name == "everything"
