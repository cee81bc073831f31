"""Test episodes, stored and of a seed, and what happens when stored ones are changed."""

import gzip
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym.benchmark.episodes import (
    FOLDER,
    Episodes,
    draw_episodes,
    find_episodes,
    load_episodes,
    scenarios,
    store_episodes,
    time_limit,
    training_episodes,
)
from pter_gym.controllers import Free
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL
from pter_gym.paths import Line
from pter_gym.scenarios import PACES, SCENARIOS, Scenario, find_scenario
from pter_gym.scenarios._evaluation_draws import FRESH, evaluation_draws
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from rollouts import simulate

PINNED_SEEDS, PINNED_PHASE = (4215971544462223395, 7145062265811555858), 1.929293725323279
"""Of the first test episodes of one seed: a seed in results means the same episodes for ever."""

SOME = [
    "standard",
    *(pytest.param(n, marks=pytest.mark.long) for n in SCENARIOS if n != "standard"),
]

TASKS = (PathFollowing(), PathFollowing(path=Line(length=0.5)), PathFollowing())


def store(folder: Path, version: int = 1, seeds: tuple[Any, ...] = (3, 1, 2)) -> Path:
    machines = (BASELINE, DELRIN_EXPERIMENTAL, BASELINE)
    return store_episodes(
        Episodes("mine", machines, TASKS, seeds, ("a", "b", "a")), version=version, folder=folder
    )


def test_stored_episodes_round_trip_byte_for_byte(tmp_path: Path) -> None:
    path = store(tmp_path / "some" / "where")
    episodes = load_episodes("mine", "brisk", folder=path.parent)
    assert [task.path for task in episodes.tasks] == [task.path for task in TASKS]
    assert {task.pace for task in episodes.tasks} == {PACES["brisk"]}
    slow = load_episodes("mine", "slow", folder=path.parent)
    assert slow.time_limits == tuple(map(time_limit, slow.tasks)) != episodes.time_limits
    assert episodes.machines[1] == DELRIN_EXPERIMENTAL
    assert episodes.machines[0] is episodes.machines[2]
    assert episodes.tasks[0] is episodes.tasks[2]
    assert (episodes.seeds, episodes.strata) == ((3, 1, 2), ("a", "b", "a"))
    assert len(json.loads(gzip.decompress(path.read_bytes()))["parts"]) == 4
    assert (
        store(tmp_path / "again").read_bytes()
        == path.read_bytes()
        != store(tmp_path / "new", 2).read_bytes()
    )
    assert scenarios(path.parent) == ("mine",)
    with pytest.raises(ValueError, match="JSON"):
        store(tmp_path / "bad", seeds=(math.nan, 1, 2))
    assert not (tmp_path / "bad").exists()


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=lambda scenario: scenario.name)
def test_the_shipped_episodes_can_be_made_again_byte_for_byte(
    scenario: Scenario, tmp_path: Path
) -> None:
    """But for how they are compressed, which differs between versions of Python."""
    drawn = draw_episodes(scenario)
    path = store_episodes(drawn, version=scenario.version, folder=tmp_path)
    again, shipped = (gzip.decompress(file.read_bytes()) for file in (path, FOLDER / path.name))
    assert again == shipped


def test_a_new_scenario_is_drawn_by_its_name_and_version() -> None:
    new = replace(SCENARIOS["hands"], episodes=3, place=None)
    first = evaluation_draws(new)
    assert evaluation_draws(new) == first
    assert {stratum for _, _, stratum in first} <= {"HumanArm", "MultiSineHand"}
    for other in (replace(new, version=1), replace(new, name="tremor"), replace(new, place=2)):
        assert evaluation_draws(other) != first


@pytest.mark.parametrize("name", SOME)
def test_no_episode_is_drawn_twice_and_all_sets_have_the_same_strata(name: str) -> None:
    """Test episodes, stored and of several seeds and paces, and training episodes all differ."""
    fresh = [("medium", None), ("medium", 2**64 - 1), *((pace, 0) for pace in PACES)]
    sets = [find_episodes(name, pace, seed) for pace, seed in fresh]
    for each, (pace, _) in zip(sets, fresh, strict=True):
        assert {task.pace for task in each.tasks} == {PACES[pace]}
        kinds = [type(getattr(task, SCENARIOS[name].stratum)).__name__ for task in each.tasks]
        assert kinds == list(each.strata)
        assert sorted(kinds) == sorted(sets[0].strata)
        assert len(each.machines) == len(each.seeds) == len(kinds) >= 200
    pairs = [pair for each in sets for pair in zip(each.machines, each.tasks, strict=True)]
    for seed in (0, FRESH):
        pairs += SCENARIOS[name].draws.pairs(200, seed, "medium")
    drawn = [repr((machine, replace(task, pace=PACES["medium"]))) for machine, task in pairs]
    varied = [pair for pair in drawn if "random_phases=True" not in pair]
    assert len(set(varied)) == len(varied) >= 3 * 200
    resets = [seed for each in sets for seed in each.seeds]
    assert len(set(resets)) == len(resets)


def test_fresh_episodes_follow_from_the_seed() -> None:
    pinned = find_episodes("paths", "medium", 5)
    assert pinned.seeds[:2] == PINNED_SEEDS
    hand = pinned.tasks[0].hand
    assert isinstance(hand, MultiSineHand)
    assert hand.phases[0] == PINNED_PHASE


@pytest.mark.parametrize("seed", [None, 0])
def test_episodes_are_drawn_with_a_machine_that_is_named(seed: int | None) -> None:
    for machine in (BASELINE, DELRIN_EXPERIMENTAL):
        named = find_episodes("standard", "slow", seed, machine)
        assert {*named.machines, named.nominal} == {machine}
        usual = find_episodes("standard", "slow", seed)
        assert (named.tasks, named.seeds, named.strata) == (usual.tasks, usual.seeds, usual.strata)


def test_mixed_draws_have_a_seed_for_each_training_episode() -> None:
    also = replace(SCENARIOS["hands"].draws, weight=2)
    mixed = replace(SCENARIOS["standard"].draws, also=(also,))
    drawn = [training_episodes(find_scenario(mixed), "slow", 4, seed) for seed in range(2)]
    assert [len(episodes) for episodes in drawn] == [6, 6]
    assert len({seed for episodes in drawn for seed in episodes.seeds}) == 12


def test_training_draws_of_different_seeds_share_no_episode() -> None:
    sets = [set(training_episodes("standard", "slow", 4, seed).seeds) for seed in range(3)]
    assert len(set.union(*sets)) == 12


def test_bad_names_and_damaged_files_are_refused(tmp_path: Path) -> None:
    assert (
        load_episodes("standard", "slow").first(3).tasks
        == load_episodes("standard", "slow").tasks[:3]
    )
    for fresh in (None, 1):
        for field, names in {
            "scenario": ("standart", "slow"),
            "pace": ("standard", "mediun"),
        }.items():
            with pytest.raises(ParameterError, match=field):
                find_episodes(*names, fresh)
    path = store(tmp_path)
    for damage in (b"", b"{", path.read_bytes()[:-9], gzip.compress(b"3")):
        path.write_bytes(damage)
        with pytest.raises(DataError, match=path.name):
            load_episodes("mine", "slow", folder=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SOME)
@pytest.mark.parametrize("pace", PACES)
def test_every_hand_can_go_faster_than_the_pace(scenario: str, pace: str) -> None:
    """Clutches can only brake: without them, the tip gets past 1.15 times the commanded pace."""
    episodes = load_episodes(scenario, pace)
    batch = Batch(episodes.machines, episodes.tasks)
    policy = Free().bind(BASELINE, batch.layout)
    rows = simulate(batch, policy, episodes.seeds, 1000)[1:]
    speed = np.nanmax(
        np.hypot(rows[..., COLUMN.tip_velocity.x], rows[..., COLUMN.tip_velocity.y]), axis=0
    )
    paces = np.array([task.pace for task in episodes.tasks])
    assert (speed / paces).min() > 1.15
    lengths = np.array([task.path.length for task in episodes.tasks])
    forces = np.array([isinstance(task.hand, MultiSineHand) for task in episodes.tasks])
    arrive = forces & (np.nanmax(rows[..., COLUMN.reached], axis=0) >= lengths)
    assert (lengths / np.nanmax(rows[..., COLUMN.time], axis=0) / paces)[arrive].min(
        initial=np.inf
    ) > 1.15


def test_episodes_are_read_before_any_kind_of_path_was_imported() -> None:
    code = "from pter_gym.benchmark.episodes import find_episodes; find_episodes('paths', 'slow')"
    subprocess.run([sys.executable, "-c", code], check=True)
