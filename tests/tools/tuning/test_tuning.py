"""The search for gains: what it scores, what it keeps, and what it never reads."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pter_gym.benchmark import Assessment, Examination
from pter_gym.benchmark._examination import MISSING, RESERVE
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark.boards import COMPLETION, PACE_ERROR
from pter_gym.benchmark.tuned import TABLE, TUNABLE, controller_of, find_tuned, read_table
from pter_gym.controllers import CONTROLLERS, Controller, Impedance, PaceSchedule
from pter_gym.errors import DataError, DependencyError, ParameterError, StorageError
from pter_gym.params import DELRIN_EXPERIMENTAL
from pter_gym.scenarios import PACES
from pter_gym.tools.tuning import SPACES, TunedGains, add_gains, tune
from pter_gym.tools.tuning.search import JOURNAL_LINE, make, open_journal
from pter_gym.tools.tuning.spaces import Range, gains_at, point_at

optuna = pytest.importorskip("optuna")
pytest.importorskip("cmaes")
storages = pytest.importorskip("optuna.storages")


def study_in(storage: Path, start: int = 0) -> Any:
    """A start of the one search in a storage."""
    journal = storages.JournalStorage(storages.journal.JournalFileBackend(str(storage)))
    return optuna.load_study(study_name=sorted(optuna.get_all_study_names(journal))[start], storage=journal)


def finished(storage: Path, start: int = 0) -> list[int]:
    """Numbers of the finished trials of a start."""
    trials = study_in(storage, start).get_trials(deepcopy=False)
    return [trial.number for trial in trials if trial.value is not None]


def command(storage: Path, *arguments: str) -> list[str]:
    given = ["tune", "impedance", "--pace", "brisk", "--starts", "1", "--episodes", "4", "--storage"]
    return [sys.executable, "-m", "pter_gym._commands.main", *given, str(storage), *arguments]


def test_penalties_grow_without_a_jump() -> None:
    good = Assessment(0.02, 1.0, 0.05, 0.1)
    assert good.value == 0.02
    for field, at_limit, step in (
        ("completed", 1.0 - MISSING * (1.0 - COMPLETION), -0.01),
        ("mean_pace_error", RESERVE * PACE_ERROR, 0.01),
        ("segment_pace_error", RESERVE * PACE_ERROR, 0.01),
    ):
        assert good._replace(**{field: at_limit}).value == pytest.approx(0.02, abs=1e-9)
        assert good._replace(**{field: at_limit + step}).value == pytest.approx(0.03, abs=1e-9)


@pytest.mark.parametrize("name", TUNABLE)
def test_points_and_gains_go_both_ways(name: str) -> None:
    kind = CONTROLLERS[name]
    default = replace(kind(), pace_fraction=0.5)  # type: ignore[call-arg]
    point = point_at(name, default, 0.25)
    again = kind(**gains_at(point, 0.25))
    assert set(point) == set(SPACES[name])
    for gain, space in SPACES[name].items():
        if gain != "braking" and isinstance(space, Range):
            wanted = min(max(getattr(default, gain), space.low), space.high)
            assert getattr(again, gain) == pytest.approx(wanted, rel=1e-3)
    assert again.damping_tangential == pytest.approx(default.damping_tangential, rel=1e-3)  # type: ignore[attr-defined]


def test_a_study_is_repeatable_resumable_and_starts_with_known_gains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pter_gym.tools.tuning.search.STARTUP", 4)
    calls: list[tuple[int, float]] = []
    whole = tune(
        "impedance",
        "standard",
        "brisk",
        trials=9,
        starts=2,
        episodes=4,
        storage=tmp_path / "a.journal",
        on_trial=lambda *c: calls.append(c),
    )
    again = tune("impedance", "standard", "brisk", trials=9, starts=2, episodes=4, storage=tmp_path / "b.journal")
    assert whole == again
    assert [count for count, _ in calls] == list(range(1, 10))
    points = [[trial.params for trial in study_in(tmp_path / "a.journal", k).get_trials()] for k in range(2)]
    assert not [point for point in points[0] if point in points[1]], "each start has points of its own"
    exam = Examination("standard", "brisk", 4, seed=0)
    shipped = find_tuned("impedance-tuned", "standard").at(PACES["brisk"])
    paper = find_policy("impedance").at(PACES["brisk"])  # type: ignore[union-attr]
    first, second = (point_at("impedance", known, 0.5) for known in (shipped, paper))
    assert points[0][:2] == [first, second]
    assert calls[0][1] == exam.judge(make("impedance", gains_at(first, 0.5))).value
    assert calls[0][1] == pytest.approx(exam.judge(shipped).value, rel=0.05)
    even = tune(
        "impedance", "standard", "brisk", trials=9, starts=2, episodes=4, storage=tmp_path / "c.journal", known=False
    )
    assert not even.known
    tried = [trial.params for trial in study_in(tmp_path / "c.journal").get_trials()]
    assert first not in tried
    assert second not in tried
    more = tune("impedance", "standard", "brisk", trials=12, starts=2, episodes=4, storage=tmp_path / "a.journal")
    assert (more.trials, more.starts) == (12, 2)
    shares = [len(finished(tmp_path / "a.journal", start)) for start in range(2)]
    assert sorted(shares) == [4, 8], "a third for each start, and one for the better"


def test_only_trials_that_keep_up_are_judged_on_all_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pter_gym.tools.tuning.search.STARTUP", 4)
    judged: list[int] = []
    judge = Examination.judge

    def counting(self: Examination, controller: Controller) -> Assessment:
        judged.append(len(self.tasks))
        return judge(self, controller)

    monkeypatch.setattr(Examination, "judge", counting)
    tune("impedance", "standard", "brisk", trials=40, starts=1, episodes=32, storage=tmp_path / "a.journal")
    search = judged[: -judged.count(32) // 2]  # fewer than FINALISTS, so each is judged on other draws too
    assert search[:3] == [2, 8, 32]
    assert search.count(2) == 40 > search.count(8) > search.count(32) >= 1
    trials = study_in(tmp_path / "a.journal").get_trials(states=(optuna.trial.TrialState.COMPLETE,))
    assert len(trials) == search.count(32)
    for draws, value in ((2, trials[-1].intermediate_values[1]), (32, trials[-1].value)):
        exam = Examination("standard", "brisk", draws, seed=0)
        assert judge(exam, make("impedance", gains_at(trials[-1].params, 0.5))).value == value


def held(path: Path) -> Any:
    """The finished trials in a journal."""
    trials = study_in(path).get_trials()
    return [(trial.number, trial.params, trial.value) for trial in trials if trial.value is not None]


def test_half_a_line_in_the_journal_costs_nothing(tmp_path: Path) -> None:
    storage = tmp_path / "a #?%b.db"
    tune("impedance", "standard", "brisk", trials=3, starts=1, episodes=4, storage=storage)
    before = held(storage)
    with storage.open("ab") as file:
        file.write(b'{"op_code":6,"worker_id":"')
    tune("impedance", "standard", "brisk", trials=5, starts=1, episodes=4, storage=storage)
    assert held(storage)[:3] == before
    assert len(held(storage)) == 5
    assert all(line.startswith(JOURNAL_LINE) for line in storage.read_bytes().splitlines())


def test_a_file_of_somebody_is_refused_as_storage_and_stays(tmp_path: Path) -> None:
    storage, content = tmp_path / "notes.txt", b'{"mine": 1}'
    storage.write_bytes(content)
    with pytest.raises(ParameterError, match="storage must be a journal file"):
        tune("impedance", "standard", "brisk", trials=1, starts=1, episodes=2, storage=storage)
    assert storage.read_bytes() == content


def test_a_full_disk_is_told_and_the_search_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    storage, done = tmp_path / "trials.journal", []

    def fill(count: int, _: float) -> None:
        done.append(count)
        if count == 3:
            monkeypatch.setattr("os.fsync", full)

    given: Any = {"starts": 1, "episodes": 4, "storage": storage}
    with pytest.raises(StorageError, match=r"storage .* cannot be written: No space left"):
        tune("impedance", "standard", "brisk", trials=5, on_trial=fill, **given)
    monkeypatch.undo()
    before = held(storage)
    assert len(before) == 3
    tune("impedance", "standard", "brisk", trials=5, **given)
    assert held(storage)[:3] == before


@pytest.mark.slow
def test_the_search_opens_no_evaluation_episodes(tmp_path: Path) -> None:
    watch = (
        "import sys\n"
        "opened = []\n"
        "sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == 'open' else None)\n"
        "from pter_gym._commands.main import main\n"
        f"assert main({command(tmp_path / 'trials.journal', '--trials', '2')[3:]!r}) == 0\n"
        "assert any(name.endswith('trials.journal') or name.endswith('.py') for name in opened)\n"
        "assert not [name for name in opened if 'episodes' in name.replace(chr(92), '/').split('/')], opened\n"
    )
    subprocess.run([sys.executable, "-c", watch], check=True, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("impedence", "standard", "brisk"), "did you mean 'impedance'"),
        (("impedance", "standart", "brisk"), "did you mean 'standard'"),
        (("impedance", "standard", "brisc"), "did you mean 'brisk'"),
        (("free", "standard", "brisk"), "controller"),
    ],
)
def test_unknown_names_are_refused(arguments: tuple[str, str, str], message: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=message):
        tune(*arguments, storage=tmp_path / "trials.journal")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "value"),
    [("trials", 0), ("starts", 0), ("episodes", 0), ("seed", -1), ("storage", Path("/nowhere/trials.journal"))],
)
def test_bad_numbers_and_storages_are_refused(name: str, value: object, tmp_path: Path) -> None:
    given: dict[str, object] = {"storage": tmp_path / "trials.journal", name: value}
    with pytest.raises(ParameterError, match=name):
        tune("impedance", "standard", "brisk", **given)  # type: ignore[arg-type]


def test_without_optuna_there_is_a_hint(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(DependencyError, match=r"'\.\[tune\]'"):
        tune("impedance", "standard", "brisk", storage=tmp_path / "trials.journal")


def test_a_search_for_another_machine_is_another_one(tmp_path: Path) -> None:
    storage = tmp_path / "trials.journal"
    given: dict[str, Any] = {"trials": 3, "starts": 1, "episodes": 4, "storage": storage}
    usual = tune("impedance", "standard", "brisk", **given)
    named = tune("impedance", "standard", "brisk", machine="delrin_experimental", **given)
    itself = tune("impedance", "standard", "brisk", machine=DELRIN_EXPERIMENTAL, **given)
    assert (usual.machine, named.machine) == (None, "delrin_experimental")
    assert named == replace(itself, machine="delrin_experimental")
    assert named.assessment != usual.assessment
    assert len(optuna.get_all_study_names(open_journal(storage))) == 2


FOUND = TunedGains(
    controller="impedance",
    scenario="standard",
    pace="slow",
    gains={"stiffness": 123.4, "tip_space": True},
    assessment=Assessment(0.0123, 1.0, 0.05, 0.1),
    trials=7,
    starts=2,
    episodes=8,
    seed=9,
)


def test_gains_are_written_beside_others_and_found(tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    add_gains(replace(FOUND, scenario="everything", pace="brisk"), path)
    add_gains(replace(FOUND, gains={"stiffness": 1.0}), path)
    add_gains(FOUND, path)
    table = read_table(path)
    assert list(table) == ["standard", "everything"]
    assert table["standard"]["impedance"]["slow"] == {
        "command": "pter tune impedance --scenario standard --pace slow --trials 7 --starts 2 --episodes 8 --seed 9",
        "trials": 7,
        "starts": 2,
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
    assert find_tuned("impedance-tuned", "standard", path=path) == PaceSchedule(((PACES["slow"], tuned),))
    fallback = PaceSchedule(((PACES["brisk"], tuned),))
    assert find_tuned("impedance-tuned", "paths", path=path) == fallback
    assert find_tuned("impedance-tuned", path=path) == fallback
    with pytest.raises(ParameterError, match="no tuned gains of 'single-dof'"):
        find_tuned("single-dof-tuned", "standard", path=path)
    with pytest.raises(ParameterError, match="did you mean 'impedance-tuned'"):
        find_tuned("impedence-tuned", "standard", path=path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[standard", "cannot be read"),
        ("standard = 1", "must be a table"),
        ("[standard.free.slow]\ngains = {}", "no controller with gains"),
        ("[standard.impedance.fast]\ngains = {}", "no pace"),
        ("[standard.impedance.slow]\ncommand = ''", "gains must be a table"),
        ("[standard.impedance.slow]\ngains = { stifness = 1.0 }", "no gain 'stifness'"),
        ("[standard.impedance.slow]\ngains = { stiffness = -1.0 }", "stiffness must be"),
    ],
)
def test_a_broken_table_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "tuned.toml"
    path.write_text(text)
    with pytest.raises(DataError, match=message):
        find_tuned("impedance-tuned", "standard", path=path)


SHIPPED = [
    pytest.param(scenario, name, pace, marks=() if (scenario, pace) == ("standard", "brisk") else pytest.mark.long)
    for scenario, controllers in read_table().items()
    for name, paces in controllers.items()
    for pace in paces
]


@pytest.mark.parametrize(("scenario", "name", "pace"), SHIPPED)
def test_shipped_gains_have_their_published_scores_bit_for_bit(scenario: str, name: str, pace: str) -> None:
    entry = read_table()[scenario][name][pace]
    words = entry["command"].split()
    seed = int(words[words.index("--seed") + 1])
    exam = Examination(scenario, pace, entry["episodes"], 2 * seed + 1)
    found = exam.judge(controller_of(name, entry, TABLE))
    assert found._asdict() == {score: entry[score] for score in Assessment._fields}


def test_shipped_gains_cover_all_controllers_and_paces_of_standard() -> None:
    table = read_table()
    assert set(table["standard"]) == set(TUNABLE)
    for name in TUNABLE:
        assert set(table["standard"][name]) == set(PACES)
        schedule = find_policy(f"{name}-tuned", scenario="standard")
        assert isinstance(schedule, PaceSchedule)
        assert [pace for pace, _ in schedule.knots] == sorted(PACES.values())
