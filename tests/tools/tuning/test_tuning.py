"""The search for gains: what it scores, what it keeps, and what it never reads."""

import pickle
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym.benchmark import (
    Assessment,
    Episodes,
    assess,
    evaluate,
    run_scenario,
    training_episodes,
)
from pter_gym.benchmark.boards import COMPLETION, PACE_ERROR
from pter_gym.benchmark.policies import find_policy
from pter_gym.benchmark.rollout import RESERVE
from pter_gym.controllers import CONTROLLERS, AnyPolicy, Impedance, PaceSchedule
from pter_gym.controllers._names import LAWS
from pter_gym.errors import DataError, DependencyError, ParameterError, StorageError
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL
from pter_gym.paths import Circle, Line
from pter_gym.policies.tuned import (
    SCALED,
    TABLE,
    controller_of,
    find_tuned,
    guided,
    read_gains,
    tuned_policies,
    with_gains,
)
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tools.device.data_sheet import machine_of_sheet
from pter_gym.tools.tuning import search
from pter_gym.tools.tuning.gains_file import add_gains
from pter_gym.tools.tuning.laws import Range, find_law
from pter_gym.tools.tuning.search import TunedGains, open_journal, tune

optuna = pytest.importorskip("optuna")
pytest.importorskip("cmaes")
Evolution = pytest.importorskip("pter_gym.tools.tuning.evolution").Evolution

CASE = ("impedance", "standard", "brisk")


def trials_in(storage: Path) -> list[Any]:
    """The scored trials of the one search in a storage."""
    journal = open_journal(storage)
    (name,) = optuna.get_all_study_names(journal)
    trials = optuna.load_study(study_name=name, storage=journal).get_trials()
    return [trial for trial in trials if trial.value is not None]


def told_by(storage: Path) -> list[tuple[int, Any, float]]:
    return [(trial.number, trial.params, trial.value) for trial in trials_in(storage)]


def test_penalties_are_continuous() -> None:
    good = Assessment(0.02, 1.0, 0.05, 0.1)
    assert good.value == 0.02
    for field, at_limit, step in (
        ("completed", COMPLETION + RESERVE["completed"], -0.01),
        ("mean_pace_error", PACE_ERROR - RESERVE["mean_pace_error"], 0.01),
        ("segment_pace_error", PACE_ERROR - RESERVE["segment_pace_error"], 0.01),
    ):
        assert good._replace(**{field: at_limit}).value == pytest.approx(0.02, abs=1e-9)
        assert good._replace(**{field: at_limit + step}).value == pytest.approx(0.03, abs=1e-9)


@pytest.mark.smoke
@pytest.mark.parametrize("name", guided())
def test_points_and_gains_go_both_ways(name: str) -> None:
    law = find_law(name, 0.25, "standard")
    default: Any = replace(law.law, pace_fraction=0.5)
    (point,) = replace(law, known=((0.25, default),)).starts()
    again: Any = law.with_gains(law.gains(point))
    assert set(point) == set(law.space)
    for gain, space in law.space.items():
        if gain != "braking" and isinstance(space, Range):
            wanted = min(max(getattr(default, gain), space.low), space.high)
            assert getattr(again, gain) == pytest.approx(wanted, rel=1e-3)
    assert again.damping_tangential == pytest.approx(default.damping_tangential, rel=1e-3)


@pytest.mark.parametrize(("path", "shown"), [(Line(), False), (Circle(), True)])
def test_a_gain_that_multiplies_the_curvature_is_searched_where_a_path_bends(
    path: Any, shown: bool
) -> None:
    law = find_law("single-dof", 0.25, "standard")
    tasks = [PathFollowing(), PathFollowing(path=path)]
    found = law.shown_by(tasks)
    assert {*law.space} - {*found.space} == (set() if shown else {"lead"})
    assert ("lead" in found.starts()[0]) == shown
    unknown = replace(law, law=SimpleNamespace(needs={"lead": "curvatur"}))
    with pytest.raises(ParameterError, match="'curvature'"):
        unknown.shown_by(tasks)


def test_a_search_is_repeatable_resumable_and_begins_with_known_gains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pter_gym.tools.tuning.search.STARTUP_TRIALS", 4)
    calls: list[tuple[int, float]] = []
    first, second = tmp_path / "a.journal", tmp_path / "b.journal"
    given: dict[str, Any] = {"trials": 16, "episodes": 4}  # a generation, and a part of one
    found = tune(*CASE, **given, storage=first, on_trial=lambda *told: calls.append(told))
    for trials in (2, 8, 14):
        assert tune(*CASE, **given | {"trials": trials}, storage=second).trials == trials
    assert found == tune(*CASE, **given, storage=second)
    assert told_by(first) == told_by(second)
    assert [count for count, _ in calls] == list(range(1, 17))
    shipped = find_tuned("impedance-tuned", "standard").at(PACES["brisk"])
    paper = find_policy("impedance").at(PACES["brisk"])  # type: ignore[union-attr]
    law = find_law("impedance", 0.5, "standard")
    points = replace(law, known=((0.5, shipped), (0.5, paper))).starts()
    assert [trial.params for trial in trials_in(first)[:2]] == points
    draws = training_episodes("standard", "brisk", 4, seed=0)
    assert calls[0][1] == assess([law.with_gains(law.gains(points[0]))], draws).value


@pytest.mark.filterwarnings("ignore:Argument:optuna.exceptions.ExperimentalWarning")
@pytest.mark.parametrize("known", [0, 2])
def test_points_are_those_of_a_sampler_that_keeps_its_state(known: int) -> None:
    space: Any = {"b": Range(1.0, 9.0), "on": (False, True), "a": Range(0.0, 2.0)}

    def value(trial: Any) -> float:
        b, on = (
            trial.suggest_float("b", 1.0, 9.0, log=True),
            trial.suggest_categorical("on", space["on"]),
        )
        return (b - 2.0) ** 2 + (trial.suggest_float("a", 0.0, 2.0) - 1.5) ** 2 + 0.1 * on

    points = []
    for sampler in (
        Evolution(space, known=known, random=4, seed=5),
        optuna.samplers.CmaEsSampler(
            seed=5, n_startup_trials=4, warn_independent_sampling=False, consider_pruned_trials=True
        ),
    ):
        study = optuna.create_study(sampler=sampler)
        for k in range(known):
            study.enqueue_trial({"b": 2.0 + k, "on": True, "a": 1.0})
        study.optimize(value, n_trials=40)
        points.append([list(trial.params.values()) for trial in study.trials])
    np.testing.assert_allclose(*points, rtol=1e-9)
    assert len(points[0]) == 40


class Hostile:
    """What is unpickled creates a file."""

    def __init__(self, created: Path) -> None:
        self.created = created

    def __reduce__(self) -> Any:
        return Path.touch, (self.created,)


def test_nothing_in_a_journal_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pter_gym.tools.tuning.search.STARTUP_TRIALS", 2)
    given: dict[str, Any] = {"episodes": 2, "storage": tmp_path / "theirs.journal"}
    tune(*CASE, trials=3, **given)
    journal, created = open_journal(given["storage"]), tmp_path / "created"
    (name,) = optuna.get_all_study_names(journal)
    study = optuna.load_study(study_name=name, storage=journal)
    payload = pickle.dumps(Hostile(created)).hex()
    for key in ("cma:optimizer:0", "cma:generation"):
        study.add_trial(with_attributes(study.trials[-1], {key: payload}))
    tune(*CASE, trials=14, **given)
    assert len(trials_in(given["storage"])) == 14
    assert not created.exists()


def with_attributes(trial: Any, attributes: dict[str, Any]) -> Any:
    return optuna.trial.create_trial(
        params=trial.params,
        distributions=trial.distributions,
        value=trial.value,
        system_attrs=attributes,
    )


def test_only_trials_that_keep_up_are_judged_on_all_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pter_gym.tools.tuning.search.STARTUP_TRIALS", 4)
    judged: list[int] = []

    def counting(policies: list[AnyPolicy], draws: Episodes, *, worst: bool) -> Assessment:
        judged.append(len(draws))
        return assess(policies, draws, worst=worst)

    monkeypatch.setattr(search, "assess", counting)
    tune("impedance", "standard", "brisk", trials=40, episodes=32, storage=tmp_path / "a.journal")
    # fewer than FINALISTS, so each is judged on other draws too
    tried = judged[: -judged.count(32) // 2]
    assert tried[:3] == [2, 8, 32]
    assert tried.count(2) == 40 > tried.count(8) > tried.count(32) >= 1
    trials = [
        trial for trial in trials_in(tmp_path / "a.journal") if trial.state.name == "COMPLETE"
    ]
    assert len(trials) == tried.count(32)
    for draws, value in ((2, trials[-1].intermediate_values[1]), (32, trials[-1].value)):
        law = find_law("impedance", 0.5, "standard")
        policy = law.with_gains(law.gains(trials[-1].params))
        assert assess([policy], training_episodes("standard", "brisk", draws, 0)).value == value


def test_the_largest_error_may_count_in_place_of_the_mean(tmp_path: Path) -> None:
    storage = tmp_path / "a.journal"
    found = tune(*CASE, trials=1, episodes=8, storage=storage, worst=True)
    (trial,) = trials_in(storage)
    law = find_law("impedance", 0.5, "standard")
    policy = law.with_gains(law.gains(trial.params))
    draws = training_episodes("standard", "brisk", 8, 0)
    largest = evaluate(policy, draws)["path_error_m"].max()
    mean = assess([policy], draws)
    assert trial.value - largest == pytest.approx(mean.value - mean.path_error_m, abs=1e-12)
    assert found.command.endswith(" --worst")
    tune(*CASE, trials=1, episodes=8, storage=storage)
    assert len(optuna.get_all_study_names(open_journal(storage))) == 2


def test_a_full_disk_is_reported_and_the_search_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    storage = tmp_path / "trials.journal"

    def fill(count: int, _: float) -> None:
        if count == 3:
            monkeypatch.setattr("pathlib.Path.open", full)

    with pytest.raises(StorageError):
        tune(*CASE, trials=5, episodes=4, storage=storage, on_trial=fill)
    monkeypatch.undo()
    before = told_by(storage)
    assert len(before) == 3
    tune(*CASE, trials=5, episodes=4, storage=storage)
    assert told_by(storage)[:3] == before


def test_bad_arguments_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {"storage": tmp_path / "trials.journal"}
    for names, field in (
        (("free", *CASE[1:]), "law"),
        (("impedance", "standart", "brisk"), "scenario"),
    ):
        with pytest.raises(ParameterError, match=field):
            tune(*names, **given)
    bad = {"trials": 0, "episodes": 0, "seed": -1, "storage": Path("/nowhere/trials.journal")}
    for field, value in bad.items():
        with pytest.raises(ParameterError, match=field):
            tune(*CASE, **{**given, field: value})
    assert not list(tmp_path.iterdir())
    notes = tmp_path / "notes.txt"
    notes.write_text('{"mine": 1}\n')
    with pytest.raises(ParameterError, match="storage"):
        tune(*CASE, trials=1, episodes=2, storage=notes)
    assert notes.read_text() == '{"mine": 1}\n'
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(DependencyError):
        tune(*CASE, **given)


def test_a_search_for_another_machine_is_another_one(tmp_path: Path) -> None:
    given: dict[str, Any] = {"trials": 2, "episodes": 4, "storage": tmp_path / "trials.journal"}
    usual = tune(*CASE, **given)
    named = tune(*CASE, machine="delrin_experimental", **given)
    assert named == replace(
        tune(*CASE, machine=DELRIN_EXPERIMENTAL, **given), machine="delrin_experimental"
    )
    assert named.assessment != usual.assessment
    assert len(optuna.get_all_study_names(open_journal(given["storage"]))) == 2


def test_a_search_does_not_depend_on_the_unit_of_the_drive(tmp_path: Path) -> None:
    """One device told in volts or amperes: the same gains, and the same error but for rounding."""
    given: dict[str, Any] = {"trials": 3, "episodes": 2, "storage": tmp_path / "trials.journal"}
    usual, *others = (
        tune(
            *("torque-feedback", "standard", "medium"),
            machine=machine_of_sheet(torque=40.0, at=top, off=0.4, lag=0.05),
            path=Line(length=0.1),
            **given,
        )
        for top in (24.0, 12.0, 0.25, 250.0)
    )
    for each in others:
        assert each.gains == usual.gains
        assert each.assessment == pytest.approx(usual.assessment, rel=1e-4)


FOUND = TunedGains(
    controller="impedance",
    scenario="standard",
    pace="slow",
    gains={"stiffness": 123.4, "tip_space": True},
    assessment=Assessment(0.0123, 1.0, 0.05, 0.1),
    trials=7,
    episodes=8,
    seed=9,
)


def test_gains_are_written_beside_others_and_found(tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    add_gains(replace(FOUND, scenario="everything", pace="brisk"), path)
    add_gains(replace(FOUND, gains={"stiffness": 1.0}, seed=8), path)
    with pytest.raises(ParameterError, match="replace"):
        add_gains(FOUND, path)
    add_gains(FOUND, path, replace=True)
    add_gains(FOUND, path)  # the same
    table = read_gains(path)
    assert list(table) == ["standard", "everything"]
    assert table["standard"]["impedance"]["slow"] == {
        "command": "pter tune impedance --scenario standard --pace slow"
        " --trials 7 --episodes 8 --seed 9",
        "trials": 7,
        "episodes": 8,
        "path_error_m": 0.0123,
        "completed": 1.0,
        "mean_pace_error": 0.05,
        "segment_pace_error": 0.1,
        "gains": {"stiffness": 123.4, "tip_space": True},
        "defaults": {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in vars(Impedance()).items()
            if name not in ("stiffness", "tip_space")
        },
    }
    tuned = Impedance(stiffness=123.4, tip_space=True)
    assert find_tuned("impedance-tuned", "standard", path=path) == PaceSchedule(
        ((PACES["slow"], tuned),)
    )
    fallback = PaceSchedule(((PACES["brisk"], tuned),))
    assert find_tuned("impedance-tuned", "paths", path=path) == fallback
    assert find_tuned("impedance-tuned", path=path) == fallback
    with pytest.raises(ParameterError, match="policies"):
        find_tuned("single-dof-tuned", "standard", path=path)
    with pytest.raises(ParameterError, match="policies"):
        find_tuned("impedence-tuned", "standard", path=path)
    assert find_policy(str(path), "standard") == PaceSchedule(((PACES["slow"], tuned),))
    assert find_policy(path, "everything") == fallback
    older = tmp_path / "older.toml"
    older.write_text(re.sub(r"damping_normal = [\d.]+", "damping_normal = 17.5", path.read_text()))
    stored = replace(tuned, damping_normal=17.5)
    assert find_policy(older, "standard") == PaceSchedule(((PACES["slow"], stored),))
    for name in (str(path), str(tmp_path / "missing.toml")):
        with pytest.raises(ParameterError, match="policies"):  # two scenarios, or no file
            find_policy(name, "paths")


def test_gains_for_two_machines_are_not_mixed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, other = tmp_path / "tuned.toml", replace(FOUND, machine="delrin_experimental")
    add_gains(other, path)
    for again in (replace(FOUND, pace="brisk"), replace(FOUND, controller="single-dof", gains={})):
        with pytest.raises(ParameterError, match="another machine"):
            add_gains(again, path, replace=True)
    add_gains(replace(other, pace="brisk", machine=DELRIN_EXPERIMENTAL), path)
    add_gains(replace(FOUND, scenario="paths"), path)
    assert read_gains(path)["standard"]["impedance"].keys() == {"slow", "brisk"}
    storage = tmp_path / "none.journal"
    line = f"tune impedance --pace medium --trials 1 --storage {storage} --out {path}"
    assert main(line.split()) == 2
    assert "another machine" in capsys.readouterr().err
    assert not storage.exists()  # refused before the search
    digest = find_scenario("standard", DELRIN_EXPERIMENTAL).digest
    path.write_text(path.read_text().replace(digest, "0123456789abcdef", 1))
    with pytest.raises(DataError, match="same machines"):
        read_gains(path)


@pytest.mark.parametrize(
    "text",
    [
        "[standard",
        "standard = 1",
        "[standard.free.slow]\ngains = {}",
        "[standard.impedance.fast]\ngains = {}",
        "[standard.impedance.slow]\ncommand = ''",
        "[standard.impedance.slow]\ngains = { stifness = 1.0 }",
        "[standard.impedance.slow]\ngains = { stiffness = -1.0 }",
    ],
)
def test_a_broken_table_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    path.write_text(text)
    with pytest.raises(DataError):
        find_tuned("impedance-tuned", "standard", path=path)


SHIPPED = [
    pytest.param(
        scenario,
        name,
        pace,
        marks=() if (scenario, pace) == ("standard", "brisk") else pytest.mark.long,
    )
    for scenario, controllers in read_gains().items()
    for name, paces in controllers.items()
    for pace in paces
]


@pytest.mark.parametrize(("scenario", "name", "pace"), SHIPPED)
def test_shipped_gains_have_their_published_scores_bit_for_bit(
    scenario: str, name: str, pace: str
) -> None:
    entry = read_gains()[scenario][name][pace]
    words = entry["command"].split()
    seed = int(words[words.index("--seed") + 1])
    draws = training_episodes(scenario, pace, entry["episodes"], 2 * seed + 1)
    law: Any = controller_of(name, entry, TABLE)
    if "release" in entry["defaults"]:  # chosen after the search
        law = replace(law, release=0.0)
    found = assess([law], draws)
    assert found._asdict() == {score: entry[score] for score in Assessment._fields}


def test_shipped_gains_cover_all_controllers_and_paces_of_standard() -> None:
    table = read_gains()
    assert set(table["standard"]) == set(guided())
    assert set(tuned_policies()) == {SCALED, *(f"{name}-tuned" for name in guided())}
    for name in guided():
        assert set(table["standard"][name]) == set(PACES)
        schedule = find_policy(f"{name}-tuned", scenario="standard")
        assert isinstance(schedule, PaceSchedule)
        assert [pace for pace, _ in schedule.knots] == sorted(PACES.values())


LAW = """
from dataclasses import dataclass
from pter_gym.controllers import Free, Impedance

@dataclass(frozen=True)
class Law:
    stiffness: float = 500.0
    tip_space: bool = False
    search = {"stiffness": (100.0, 2000.0), "tip_space": (False, True)}

    def bind(self, machine, layout):
        return Impedance(stiffness=self.stiffness, tip_space=self.tip_space).bind(machine, layout)

class Reversed(Law):
    search = {"stiffness": (5.0, 1.0)}

class Unknown(Law):
    search = {"stifness": (1.0, 5.0)}
"""


def test_a_law_of_ones_own_is_searched_within_its_ranges(tmp_path: Path) -> None:
    file = tmp_path / "own.py"
    file.write_text(LAW)
    given: dict[str, Any] = {"trials": 3, "episodes": 2, "storage": tmp_path / "own.journal"}
    found = tune(f"{file}:Law", "standard", "0.3", **given, path=Circle())
    assert found.gains.keys() == {"stiffness", "tip_space"}
    assert 100.0 <= found.gains["stiffness"] <= 2000.0
    assert {"stiffness": 500.0, "tip_space": False} in [
        trial.params for trial in trials_in(given["storage"])
    ]
    for name, match in {"Reversed": "search", "Unknown": "search", "Free": "dataclass"}.items():
        with pytest.raises(ParameterError, match=match):
            tune(f"{file}:{name}", "standard", "slow", **given)


LONG_ARM = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.8, length_b=0.7))


@pytest.mark.parametrize(
    ("machine", "path"), [(None, "circle"), (LONG_ARM, Line(x=-0.4, y=1.15, length=0.8))]
)
def test_gains_for_a_path_of_ones_own_are_stored_and_found(
    tmp_path: Path, machine: Any, path: Any
) -> None:
    given: dict[str, Any] = {"trials": 1, "episodes": 2, "storage": tmp_path / "own.journal"}
    found = tune("impedance", "standard", "0.3", **given, machine=machine, path=path)
    add_gains(found, tmp_path / "gains.toml")
    ((pace, law),) = find_policy(
        tmp_path / "gains.toml", find_scenario("standard", machine, path).whose_gains
    ).knots
    assert (pace, law.stiffness) == (0.3, found.gains["stiffness"])


class Toy(Impedance):
    """A law that is not in any table."""


def test_a_new_law_is_run_and_tuned_before_any_gains_are_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LAWS, "toy", "Toy")
    monkeypatch.setitem(CONTROLLERS, "toy", Toy)
    out = tmp_path / "toy.toml"
    line = ["tune", "toy", "--pace", "brisk", "--trials", "2", "--episodes", "2", "--storage"]
    assert main([*line, str(tmp_path / "toy.journal"), "--out", str(out)]) == 0
    gains = read_gains(out)["standard"]["toy"]["brisk"]["gains"]
    assert set(gains) - {"damping_tangential"} == set(Toy.search) - {"braking"}
    with pytest.raises(ParameterError, match="policies"):
        find_policy("toy-tuned")
    policies = {"toy": "toy", "tuned": out, "again": with_gains("toy", gains)}
    runs = run_scenario("standard", policies, "brisk", episodes=2)
    toy, tuned, again = (run.scores["path_error_m"].tolist() for run in runs)
    assert tuned == again != toy
