"""Policies that attack the process they act in: what gains there gains nothing in a process of its own."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark import attacking_policies
from benchmark.attacking_policies import HARMLESS, KEPT, REFUSED, TAMPERING, honest
from pter_gym.benchmark import Isolated, ResultsFolder, run_scenario
from pter_gym.benchmark._recorded import Travel
from pter_gym.benchmark.simulation import record_episode
from pter_gym.controllers import Free
from pter_gym.errors import ActionError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing

COUNT = 2


@pytest.fixture(autouse=True)
def clean(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Undo what attacks do to the package."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))
    monkeypatch.setattr(Travel, "segment_errors", Travel.segment_errors)
    KEPT.clear()
    yield
    KEPT.clear()


def path_errors(policy: Any) -> list[float]:
    (run,) = run_scenario("standard", {"policy": policy}, ["brisk"], episodes=COUNT)
    return run.scores["path_error_m"].tolist()


@pytest.fixture(scope="module")
def untouched() -> list[float]:
    """The path errors of the honest policy, in a package that no attack has changed."""
    return path_errors(honest)


@pytest.mark.parametrize("attack", ["reads the frames that call it", "replaces a function of the package"])
def test_in_process_a_policys_code_is_trusted(attack: str, untouched: list[float]) -> None:
    assert path_errors(TAMPERING[attack]) != untouched


@pytest.mark.slow
def test_in_a_process_of_its_own_nothing_gains(untouched: list[float]) -> None:
    with Isolated("benchmark.isolated_policies:tampers") as policy:
        assert path_errors(policy) == untouched


@pytest.mark.parametrize("attack", HARMLESS)
def test_what_it_does_to_its_own_arrays_changes_nothing(attack: str, untouched: list[float]) -> None:
    assert path_errors(HARMLESS[attack]) == untouched


@pytest.mark.parametrize("attack", REFUSED)
def test_what_is_no_voltage_is_refused_and_nothing_is_kept_of_it(attack: str, tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    with pytest.raises(ActionError, match="action"):
        run_scenario("standard", {"free": Free(), "wrong": REFUSED[attack]}, ["brisk"], episodes=1, results=results)
    assert [run.conditions.policy for run in results.runs()] == ["free"]


def test_a_recording_holds_what_was_applied() -> None:
    """A policy that changes the buffer it has returned changes no recording."""
    one, two = (
        record_episode(policy, BASELINE, PathFollowing(), 3, 20)
        for policy in (honest, attacking_policies.spoils_its_buffer)
    )
    np.testing.assert_array_equal(one.volts, two.volts)
