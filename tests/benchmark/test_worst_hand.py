"""The worst hand: found within a scenario's bounds, replayed bit for bit, stored and filmed."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym.benchmark import (
    Episodes,
    ResultsFolder,
    find_policy,
    find_worst,
    run_scenario,
    score,
    worst_hand,
)
from pter_gym.benchmark.results import read_run
from pter_gym.benchmark.rollout import record_episode
from pter_gym.benchmark.scores import CONFIDENCE, WorstHand
from pter_gym.benchmark.worst_hand import POPULATION, Numbers
from pter_gym.controllers import Free, Impedance, bind
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import SINES, HandModel, MultiSineHand, Operator
from pter_gym.params import BASELINE, MachineSpread
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.scenarios.distributions import Draws, OneOf, Uniform, Vary
from pter_gym.tasks.path_following import Failure, PathFollowing
from rollouts import Acting

RNG = np.random.default_rng(0)


def test_numbers_stand_for_what_a_generator_draws() -> None:
    numbers = Numbers(RNG, [0.25, 0.999, 0.5, 0.0, 1.0])
    assert numbers.uniform(2.0, 6.0) == 3.0
    assert numbers.integers(4) == 3
    middle, low, high = numbers.standard_normal(3)
    assert middle == 0.0
    assert low == pytest.approx(-high)
    assert high == pytest.approx(3.29, abs=0.01)
    assert 0.0 <= numbers.uniform() < 1.0
    assert len(numbers.taken) == 6


def test_random_machines_are_as_spread_as_their_log_leaves_them() -> None:
    """Else how many hands are worse would be told of other machines: of 10⁵, 100 are beyond."""
    drawn = np.concatenate([Numbers(RNG).standard_normal(1000) for _ in range(100)])
    assert 50 < np.count_nonzero(np.abs(drawn) > 3.29) < 150


@pytest.mark.parametrize("end", [0.0, 1.0])
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_is_searched_up_to_its_bounds(name: str, end: float) -> None:
    """Machine and task are checked as they are made, and refuse what is out of range."""
    numbers: Any = Numbers(RNG, [end] * 64)
    pair: Any = SCENARIOS[name].draws.at_pace(0.25).draw_once(numbers)
    assert set(numbers.taken) <= {end}
    if name == "hands" and end == 0.0:
        assert pair is not None
        assert pair[1].hand.push == 45.0


@pytest.mark.usefixtures("few_hands")
def test_the_worst_hand_is_the_same_on_any_number_of_threads_and_replays() -> None:
    policy = find_policy("single-dof-tuned", "hands")
    found = find_worst(policy, "hands", "brisk", num_threads=1)
    assert found == find_worst(policy, "hands", "brisk", num_threads=2)
    assert found.path_error_m >= found.random_error_m > 0.0
    assert (found.random, found.tried) == (2 * POPULATION, 6 * POPULATION)
    alone = record_episode(policy, found.machine, found.task, 0).telemetry
    assert score(alone, found.task).path_error_m == found.path_error_m
    env: Any = gymnasium.make(
        "PTER/PathFollowing-v0", machine=found.machine, task=found.task, action_unit="volt"
    )
    act = Acting(bind(policy, found.machine, env.unwrapped.observation_layout))
    obs, info = env.reset(seed=0)
    for row in alone[:-1]:
        np.testing.assert_array_equal(info["telemetry"], row)
        obs, _, _, _, info = env.step(act(obs))
    np.testing.assert_array_equal(info["telemetry"], alone[-1])


@pytest.mark.parametrize("generations", [1, 40])
def test_the_search_finds_a_worst_hand_that_is_known(
    few_hands: None, monkeypatch: pytest.MonkeyPatch, generations: int
) -> None:
    """Errors fall with the distance of push and phase from those of the worst hand.

    The first generation are the worst random ones again. All are at one pace, whichever is drawn.
    """
    push, phase = 63.0, 2.0

    def error(task: PathFollowing) -> float:
        hand: Any = task.hand
        assert task.pace == PACES["medium"]
        return math.exp(-abs(hand.push - push) - abs(hand.phases[0] - phase))

    def errors(_policy: object, episodes: Episodes, _threads: int) -> np.ndarray:
        return np.array([error(task) for task in episodes.tasks])

    monkeypatch.setattr(worst_hand, "path_errors", errors)
    monkeypatch.setattr(worst_hand, "SEARCHED", generations * POPULATION)
    hand = Vary(
        MultiSineHand(), push=Uniform(45.0, 75.0), phases=(Uniform(0.0, 6.0), 0.0, 0.0, 0.0, 0.0)
    )
    task = Vary(PathFollowing(), hand=hand, pace=Uniform(0.1, 1.0))
    found = find_worst(Free(), Draws(task=task))
    assert found.path_error_m == error(found.task)
    if generations == 1:
        assert found.path_error_m == found.random_error_m
    else:
        assert found.path_error_m == pytest.approx(1.0, abs=2e-3)
        assert found.path_error_m > found.random_error_m


@pytest.mark.usefixtures("few_hands")
def test_which_clutch_fails_and_when_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    def error(task: PathFollowing) -> float:
        return sum(math.exp(-abs(each.after - 1.3)) for each in task.failures if each.clutch == 3)

    def errors(_policy: object, episodes: Episodes, _threads: int) -> np.ndarray:
        return np.array([error(task) for task in episodes.tasks])

    monkeypatch.setattr(worst_hand, "path_errors", errors)
    monkeypatch.setattr(worst_hand, "SEARCHED", 80 * POPULATION)
    clutch, after = OneOf((1, 2, 3, 4)), Uniform(0.0, 2.0)
    dead = Vary(Failure(clutch=1, torque=0.0), clutch=clutch, after=after)
    draws = Draws(task=Vary(PathFollowing(), failures=OneOf(((), (dead,)))))
    found = find_worst(Free(), draws)
    (failure,) = found.task.failures
    assert (failure.clutch, failure.torque) == (3, 0.0)
    assert failure.after == pytest.approx(1.3, abs=2e-3)


def test_each_kind_of_hand_is_searched_by_itself(
    few_hands: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first number is the push of one kind and the phase of the other, whose peak is higher."""
    populations: list[set[bool]] = []

    def error(task: PathFollowing) -> float:
        hand: Any = task.hand
        if hand.phases[0] == 0.0:
            return 0.5 * math.exp(-abs(hand.push - 47.0) / 30.0)
        return math.exp(-abs(hand.phases[0] - 5.0))

    def errors(_policy: object, episodes: Episodes, _threads: int) -> np.ndarray:
        hands: list[Any] = [task.hand for task in episodes.tasks]
        populations.append({hand.phases[0] == 0.0 for hand in hands})
        return np.array([error(task) for task in episodes.tasks])

    monkeypatch.setattr(worst_hand, "path_errors", errors)
    monkeypatch.setattr(worst_hand, "SEARCHED", 40 * POPULATION)
    usual = MultiSineHand()
    pushes = Vary(usual, push=Uniform(45.0, 75.0), phases=(0.0,) * 5)
    phases = Vary(usual, phases=(Uniform(0.1, 6.0), 0.0, 0.0, 0.0, 0.0))
    draws = Draws(task=Vary(PathFollowing(), hand=OneOf((pushes, phases))))
    found = find_worst(Free(), draws)
    assert found.random + 20 * POPULATION < found.tried <= found.random + 40 * POPULATION
    assert found.path_error_m == pytest.approx(1.0, abs=2e-3)
    first, *others = populations
    assert first == {True, False}
    assert [len(kinds) for kinds in others] == [1] * len(others)
    assert {*map(tuple, others)} == {(True,), (False,)}
    assert find_worst(Free(), draws, seed=1).random_error_m != found.random_error_m


@pytest.mark.parametrize(
    ("kinds", "generations", "expected"),
    [
        ("a" * 64, 64, {"a": 64}),
        ("a" * 48 + "b" * 16, 128, {"a": 96, "b": 32}),
        ("a" * 60 + "b" * 4, 128, {"a": 128}),
        ("abcdefghijkl", 128, dict.fromkeys("abcdefgh", 16)),
        ("ab", 8, {"a": 8}),
    ],
)
def test_kinds_share_the_generations_as_they_share_the_worst_hands(
    kinds: str, generations: int, expected: dict[str, int]
) -> None:
    named: Any = kinds
    assert worst_hand.shares(named, generations) == expected


LINES = [
    ("single-dof-tuned", "standard", "brisk"),
    ("impedance-tuned", "standard", "medium"),
    ("torque-feedback-tuned", "hands", "brisk"),
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "scenario", "pace"), LINES)
def test_another_search_with_four_times_the_budget_finds_hardly_more(
    name: str, scenario: str, pace: str
) -> None:
    """CMA-ES from random hands again and again."""
    cmaes: Any = pytest.importorskip("cmaes")
    policy, chosen = find_policy(name, scenario), SCENARIOS[scenario]
    found = find_worst(policy, scenario, pace)
    draws, rng = chosen.draws.at_pace(pace), np.random.default_rng(1)
    width = worst_hand.random_hands(chosen, PACES[pace]).numbers.shape[1]
    tried, worst = 0, 0.0
    while tried < 4 * found.tried:
        search = cmaes.CMA(mean=rng.random(width), sigma=0.3, population_size=64, seed=tried)
        while tried < 4 * found.tried and not search.should_stop():
            asked = [search.ask() for _ in range(64)]
            numbers = np.abs((np.array(asked) + 1.0) % 2.0 - 1.0)  # folded into [0, 1]
            pairs: Any = [
                worst_hand.pair_of(draws, Numbers(rng, each.tolist())) for each in numbers
            ]
            episodes = Episodes.from_pairs(scenario, chosen.draws, pairs, [0] * 64)
            errors = worst_hand.path_errors(policy, episodes)
            search.tell(list(zip(asked, -errors, strict=True)))
            tried, worst = tried + 64, max(worst, errors.max())
    assert found.path_error_m >= worst / 1.05


@pytest.mark.usefixtures("few_hands")
def test_a_scenario_that_draws_nothing_has_one_hand() -> None:
    found = find_worst(Free(), Draws(task=PathFollowing(pace=0.5)), "brisk")
    assert (found.random, found.tried) == (1, 1)


@dataclass(frozen=True, kw_only=True)
class Shaking(Operator):
    """A kind of a user's, with sines."""

    plans: ClassVar[bool] = False
    frequencies: tuple[float, ...] = MultiSineHand().frequencies
    phases: tuple[float, ...] = (0.0,) * SINES
    random_phases: bool = True

    def model(self, pace: float, substep: float, recording: tuple[int, int]) -> HandModel:
        hand = MultiSineHand(phases=self.phases, random_phases=self.random_phases)
        return hand.model(pace, substep, recording)


@pytest.mark.usefixtures("few_hands")
def test_the_phases_of_any_kind_of_hand_are_searched() -> None:
    own, known = (
        find_worst(Free(), Draws(task=PathFollowing(pace=0.5, hand=hand)), "brisk")
        for hand in (Shaking(), MultiSineHand(random_phases=True))
    )
    assert own.tried == known.tried > 1
    assert own.path_error_m == known.path_error_m
    assert own.task.hand == Shaking(phases=known.task.hand.phases, random_phases=False)


@pytest.mark.usefixtures("few_hands")
def test_machines_of_a_log_are_searched_too() -> None:
    place = "clutch_scale.1"
    spread = MachineSpread(machine=BASELINE, places=(place,), covariance=((0.01,),))
    draws = Draws(machine=spread, task=SCENARIOS["standard"].draws.task)
    found = find_worst(Impedance(), draws, "brisk")
    assert found.machine != BASELINE
    assert abs(found.machine.clutch_scale[0] - 1.0) <= 0.1 * 3.3


@pytest.mark.parametrize("random", [1, 128, 8192])
def test_random_hands_bound_how_many_are_worse(random: int) -> None:
    found = WorstHand(0.1, 0.1, random, random, BASELINE, PathFollowing())
    assert (1.0 - 1.0 / found.one_in) ** random <= 1.0 - CONFIDENCE + 1e-12
    assert (1.0 - 1.0 / (found.one_in + 1)) ** random > 1.0 - CONFIDENCE


def test_a_scenario_that_draws_nothing_says_so() -> None:
    """In place of one hand in one."""
    found = WorstHand(0.1, 0.1, 1, 1, BASELINE, PathFollowing())
    assert "one" not in found.sentence("mine").split()
    assert "12,288" in replace(found, random=8192, tried=12288).sentence("mine")


def test_a_distribution_that_cannot_be_searched_is_refused() -> None:
    @dataclass(frozen=True)
    class Skewed:
        def draw(self, rng: np.random.Generator) -> float:
            return 40.0 + rng.gamma(2.0)

        def extremes(self) -> tuple[float, ...]:
            return (40.0, 50.0)

    draws = Draws(task=Vary(PathFollowing(), hand=Vary(MultiSineHand(), push=Skewed())))
    with pytest.raises(ParameterError, match="gamma"):
        find_worst(Free(), draws, "brisk")


@pytest.mark.usefixtures("few_hands")
def test_it_is_stored_printed_and_filmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "benchmark --policies impedance --paces brisk --episodes 2 --worst --no-film --out"
    assert main([*line.split(), str(tmp_path)]) == 0
    (run,) = ResultsFolder(tmp_path).runs()
    assert run.worst
    assert run.worst == find_worst(find_policy("impedance"), "standard", "brisk")
    assert f"worst hand found in {run.worst.tried} episodes" in capsys.readouterr().out
    summary = json.loads((tmp_path / "benchmark.json").read_text())
    stored = summary["leaderboards"][0]["policies"]["impedance"]["worst_hand"]
    assert stored["path_error_m"] == run.worst.path_error_m
    watch = f"watch impedance --pace brisk --worst {tmp_path} --csv {tmp_path / 'worst.csv'}"
    assert main(watch.split()) == 0
    assert main(watch.replace("brisk", "slow").split()) == 2
    assert "error: worst must be a folder" in capsys.readouterr().err
    (file,) = (tmp_path / "runs").iterdir()
    earlier = file.read_text().replace(f'"version": "{run.version}"', '"version": "0.9.0"')
    file.write_text(earlier)
    assert main(watch.split()) == 2


@pytest.mark.usefixtures("few_hands")
@pytest.mark.parametrize(
    "damage", [{"machine": 1}, {"path_error_m": "1"}, {"unknown": 1}, {"random": 0}]
)
def test_a_damaged_one_is_refused(damage: dict[str, object], tmp_path: Path) -> None:
    (run,) = run_scenario("standard", ["free"], ["brisk"], episodes=2, results=tmp_path, worst=True)
    (path,) = (tmp_path / "runs").iterdir()
    assert read_run(path).worst == run.worst
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"worst_hand": content["worst_hand"] | damage}))
    with pytest.raises(DataError, match=path.name):
        read_run(path)
