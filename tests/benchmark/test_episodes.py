"""The stored evaluation episodes, and what happens when somebody changes them."""

import gzip
import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pter_gym.benchmark.episodes import (
    CHECKSUMS,
    FOLDER,
    SEEDS,
    find_episodes,
    fresh_episodes,
    load_episodes,
    scenarios,
    store_episodes,
)
from pter_gym.controllers import Free
from pter_gym.engine.batch import Batch
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL
from pter_gym.paths import Line
from pter_gym.scenarios import PACES, SCENARIOS, Scenario
from pter_gym.scenarios.evaluation_draws import FRESH, evaluation_draws
from pter_gym.tasks.path_following import COLUMN, PathFollowing

PINNED_SEEDS, PINNED_PHASE = (4215971544462223395, 7145062265811555858), 2.012818905321554
"""Of the first fresh episodes of one seed: results that name a seed mean the same episodes for ever."""

TASKS = [PathFollowing(), PathFollowing(path=Line(length=0.5)), PathFollowing()]


def store(folder: Path, version: int = 1) -> Path:
    machines = [BASELINE, DELRIN_EXPERIMENTAL, BASELINE]
    return store_episodes("mine", machines, TASKS, [3, 1, 2], ["a", "b", "a"], version=version, folder=folder)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(FOLDER, tmp_path / "episodes"))


@pytest.mark.parametrize("scenario", scenarios())
def test_the_package_has_whole_episodes(scenario: str) -> None:
    for pace, speed in PACES.items():
        episodes = load_episodes(scenario, pace)
        assert len(episodes) >= 200
        assert {task.pace for task in episodes.tasks} == {speed}
        assert len(episodes.machines) == len(episodes.tasks) == len(episodes.strata) == len(episodes)


def test_ranks_on_the_standard_scenario_use_many_phase_sets() -> None:
    tasks = load_episodes("standard", "medium").tasks
    hands = {task.hand for task in tasks}
    assert len(hands) >= 200
    assert all(isinstance(hand, MultiSineHand) and not hand.random_phases for hand in hands)


def test_what_was_stored_is_read(tmp_path: Path) -> None:
    path = store(tmp_path)
    episodes = load_episodes("mine", "brisk", folder=tmp_path)
    assert [task.path for task in episodes.tasks] == [task.path for task in TASKS]
    assert episodes.machines[1] == DELRIN_EXPERIMENTAL
    assert episodes.machines[0] is episodes.machines[2]
    assert episodes.tasks[0] is episodes.tasks[2]
    assert (episodes.seeds, episodes.strata) == ((3, 1, 2), ("a", "b", "a"))
    assert len(json.loads(gzip.decompress(path.read_bytes()))["parts"]) == 4
    assert scenarios(tmp_path) == ("mine",)


def test_the_same_episodes_are_the_same_bytes(tmp_path: Path) -> None:
    first, second = (store(tmp_path / name).read_bytes() for name in ("a", "b"))
    assert first == second
    assert store(tmp_path / "c", version=2).read_bytes() != first


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=lambda scenario: scenario.name)
def test_the_shipped_episodes_can_be_made_again_byte_for_byte(scenario: Scenario, tmp_path: Path) -> None:
    machines, tasks, strata = zip(*evaluation_draws(scenario), strict=True)
    seeds = range(scenario.episodes)
    path = store_episodes(
        scenario.name, machines, tasks, list(seeds), strata, version=scenario.version, folder=tmp_path
    )
    assert path.read_bytes() == (FOLDER / path.name).read_bytes()


def test_a_folder_is_made_and_its_checksums_are_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "some" / "where"
    store(folder)
    store_episodes("earlier", [BASELINE], [PathFollowing()], [3], ["a"], version=1, folder=folder)
    assert list(json.loads((folder / CHECKSUMS).read_text())) == ["earlier", "mine"]


def test_a_new_scenario_is_drawn_by_its_name_and_version() -> None:
    new = replace(SCENARIOS["hands"], episodes=3, place=None)
    first = evaluation_draws(new)
    assert evaluation_draws(new) == first
    assert {draw.stratum for draw in first} <= {"HumanArm", "MultiSineHand"}
    for other in (replace(new, version=1), replace(new, name="others"), replace(new, place=2)):
        assert evaluation_draws(other) != first


# --- fresh ones ---


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_fresh_episodes_are_as_many_with_the_same_strata(scenario: str) -> None:
    stored, fresh = load_episodes(scenario, "slow"), fresh_episodes(scenario, "slow", 7)
    assert fresh.strata == stored.strata
    assert len(fresh.machines) == len(fresh.tasks) == len(fresh.seeds) == len(stored)
    field = SCENARIOS[scenario].stratum
    assert [type(getattr(task, field)).__name__ for task in fresh.tasks] == list(fresh.strata)
    assert {task.pace for task in fresh.tasks} == {PACES["slow"]}


@pytest.mark.parametrize("name", SCENARIOS)
def test_no_episode_is_drawn_twice(name: str) -> None:
    """Stored ones, fresh ones of all paces and several seeds, and training draws have no episode in common."""
    fresh = [("medium", 2**64 - 1), *((pace, 0) for pace in PACES)]
    sets = [load_episodes(name, "medium"), *(fresh_episodes(name, pace, seed) for pace, seed in fresh)]
    pairs = [pair for each in sets for pair in zip(each.machines, each.tasks, strict=True)]
    for seed in (0, FRESH):
        pairs += SCENARIOS[name].randomisation("medium", seed=seed, contexts=200).pairs()
    drawn = [repr((machine, replace(task, pace=PACES["medium"]))) for machine, task in pairs]
    varied = [pair for pair in drawn if "random_phases=True" not in pair]
    assert len(set(varied)) == len(varied) >= 3 * 200
    resets = [seed for each in sets for seed in each.seeds]
    assert len(set(resets)) == len(resets)
    assert len({each.checksum for each in sets}) == len(sets)


def test_fresh_episodes_follow_from_the_seed() -> None:
    pinned = fresh_episodes("paths", "medium", 5)
    assert pinned.seeds[:2] == PINNED_SEEDS
    hand = pinned.tasks[0].hand
    assert isinstance(hand, MultiSineHand)
    assert hand.phases[0] == PINNED_PHASE
    assert find_episodes("paths", "medium", 5) == pinned
    assert find_episodes("paths", "medium") == load_episodes("paths", "medium")


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "7", True, None])
def test_a_seed_of_fresh_episodes_is_checked(seed: object) -> None:
    with pytest.raises(ParameterError, match="fresh must be a whole number"):
        fresh_episodes("standard", "slow", seed)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="scenario must be among"):
        fresh_episodes("standart", "slow", 1)
    with pytest.raises(ParameterError, match="pace must be among"):
        fresh_episodes("standard", "slo", 1)


def test_some_of_them() -> None:
    episodes = load_episodes("standard", "slow")
    few = episodes.first(3)
    assert (len(few), few.checksum) == (3, episodes.checksum)
    assert few.tasks == episodes.tasks[:3]
    counts: list[Any] = [0, -1, len(episodes) + 1, 2.5, "2", None]
    for count in counts:
        with pytest.raises(ParameterError, match="episodes must be from 1 to"):
            episodes.first(count)


def test_changed_episodes_are_refused(copy: Path) -> None:
    path = copy / "standard.json.gz"
    content = json.loads(gzip.decompress(path.read_bytes()))
    content["episodes"][0]["seed"] += 1
    path.write_bytes(gzip.compress(json.dumps(content).encode()))
    with pytest.raises(DataError, match=r"standard\.json\.gz were changed: SHA-256 is [0-9a-f]{64}, stored was"):
        load_episodes("standard", "slow", folder=copy)


@pytest.mark.parametrize(("part", "below"), [("machine", None), ("task", None), ("seed", SEEDS)])
def test_numbers_beyond_their_range_are_refused(part: str, below: int | None, copy: Path) -> None:
    path = copy / "standard.json.gz"
    content = json.loads(gzip.decompress(path.read_bytes()))
    content["episodes"][-1][part] = below or len(content["parts"])
    path.write_bytes(gzip.compress(json.dumps(content).encode()))
    sums = json.loads((copy / CHECKSUMS).read_text())
    sums["standard"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (copy / CHECKSUMS).write_text(json.dumps(sums))
    with pytest.raises(DataError, match=r"there must be a whole number within \[0, \d+\)"):
        load_episodes("standard", "slow", folder=copy)


@pytest.mark.parametrize("damage", [b"", b"\x00", b"not gzip"])
def test_damaged_episodes_are_refused(damage: bytes, copy: Path) -> None:
    (copy / "standard.json.gz").write_bytes(damage)
    with pytest.raises(DataError, match="were changed"):
        load_episodes("standard", "slow", folder=copy)


def test_one_bit(copy: Path) -> None:
    path = copy / "standard.json.gz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(DataError, match="were changed"):
        load_episodes("standard", "slow", folder=copy)


@pytest.mark.parametrize("name", ["standard.json.gz", CHECKSUMS])
def test_missing_files_are_named(name: str, copy: Path) -> None:
    (copy / name).unlink()
    with pytest.raises(DataError, match=f"{name} cannot be read"):
        load_episodes("standard", "slow", folder=copy)


@pytest.mark.parametrize("text", ["", "{", "3"])
def test_damaged_checksums_are_refused(text: str, copy: Path) -> None:
    (copy / CHECKSUMS).write_text(text)
    with pytest.raises(DataError, match="checksums"):
        load_episodes("standard", "slow", folder=copy)


def test_unknown_names_are_refused_with_the_nearest() -> None:
    with pytest.raises(ParameterError, match=r"scenario must be among .* did you mean 'standard'"):
        load_episodes("standart", "slow")
    with pytest.raises(ParameterError, match=r"pace must be among slow, medium, brisk, .* did you mean 'medium'"):
        load_episodes("standard", "mediun")


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("pace", PACES)
def test_every_hand_can_go_faster_than_the_pace(scenario: str, pace: str) -> None:
    """Braking is all that a clutch can do: without it, the tip gets past 1.15 times the commanded pace."""
    episodes = load_episodes(scenario, pace)
    batch = Batch(episodes.machines, episodes.tasks)
    policy = Free().bind(BASELINE, batch.layout)
    obs, _ = batch.reset(list(episodes.seeds))
    _, rows = batch.rollout(obs, policy.law, policy.gains, 1000)
    speed = np.nanmax(np.hypot(rows[..., COLUMN.tip_velocity.x], rows[..., COLUMN.tip_velocity.y]), axis=0)
    paces = np.array([task.pace for task in episodes.tasks])
    assert (speed / paces).min() > 1.15
    lengths = np.array([task.path.length for task in episodes.tasks])
    passed = np.nanmax(rows[..., COLUMN.reached], axis=0) >= lengths
    forces = passed & [isinstance(task.hand, MultiSineHand) for task in episodes.tasks]
    taken = np.nanmax(rows[..., COLUMN.time], axis=0)
    assert passed.any()
    assert forces.any() == any(isinstance(task.hand, MultiSineHand) for task in episodes.tasks)
    assert (lengths / taken / paces)[forces].min(initial=np.inf) > 1.15


def test_no_stored_episode_is_among_the_training_draws() -> None:
    for name, scenario in SCENARIOS.items():
        drawn = scenario.randomisation("medium").pairs()
        kept = load_episodes(name, "medium")
        assert not {repr(pair) for pair in zip(kept.machines, kept.tasks, strict=True)} & {repr(p) for p in drawn}
        phases = [getattr(task.hand, "phases", None) for task in kept.tasks]
        assert len(set(phases)) == len(phases)
