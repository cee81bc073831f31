"""Damaged policy cards, weights and results files are refused with a typed error, or valid."""

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from pter_gym.benchmark import ResultsFolder, find_policy, run_scenario
from pter_gym.errors import PterError
from pter_gym.policies import read_policy
from pter_gym.policies._files import SHIPPED

FUZZ = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))

ODD = st.sampled_from(
    [
        None,
        True,
        -1,
        0,
        10**400,
        1e308,
        float("nan"),
        float("inf"),
        "",
        "NaN",
        "\ud800",
        [],
        {},
        [[1.0]] * 50,
        "x" * 9999,
    ]
)
"""Values that a file may hold in place of its own."""


@st.composite
def damaged_bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Draw a content that is cut, has changed bytes, or parts twice."""
    place = draw(st.integers(0, len(content)))
    match draw(st.integers(0, 2)):
        case 0:
            return content[:place]
        case 1:
            return content[:place] + draw(st.binary(min_size=1, max_size=8)) + content[place + 8 :]
        case _:
            return content[:place] + content[place // 2 :]


@st.composite
def changed_tree(draw: st.DrawFn, tree: Any) -> Any:
    """Draw a tree of JSON in which a value is an odd one, missing, or has another name."""
    if isinstance(tree, str) and tree.startswith(("{", "[")):
        with suppress(ValueError):
            return json.dumps(draw(changed_tree(json.loads(tree))))
    if not isinstance(tree, dict | list) or not tree or draw(st.integers(0, 9)) == 0:
        return draw(ODD)
    key = draw(st.sampled_from(sorted(tree) if isinstance(tree, dict) else range(len(tree))))
    changed: Any = tree.copy()
    value = changed.pop(key)
    if draw(st.integers(0, 4)) == 0:
        return changed  # without the value
    if isinstance(changed, list):
        return [*changed[:key], draw(changed_tree(value)), *changed[key:]]
    return {**changed, draw(st.sampled_from((key, key, key, "other"))): draw(changed_tree(value))}


def damaged(content: bytes) -> st.SearchStrategy[bytes]:
    """Return a strategy for damaged files: JSON, or safetensors with a header of JSON."""
    start = 0 if content[:1] == b"{" else 8
    end = len(content) if start == 0 else 8 + int.from_bytes(content[:8], "little")

    def rebuilt(tree: Any) -> bytes:
        header = json.dumps(tree).encode()
        return header if start == 0 else len(header).to_bytes(8, "little") + header + content[end:]

    return st.one_of(
        damaged_bytes(content), changed_tree(json.loads(content[start:end])).map(rebuilt)
    )


def check(read: Callable[[], object]) -> None:
    """Read what may be damaged: any error but a typed one gets out."""
    with suppress(PterError):
        read()


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of a shipped policy."""
    return Path(shutil.copy(SHIPPED / "residual.safetensors", tmp_path_factory.mktemp("policy")))


@pytest.mark.slow
@FUZZ
@given(data=st.data())
def test_damaged_policies(policy: Path, data: st.DataObject) -> None:
    original = policy.read_bytes()
    policy.write_bytes(data.draw(damaged(original)))
    try:
        check(lambda: read_policy(policy))
    finally:
        policy.write_bytes(original)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> ResultsFolder:
    """Results of a policy that never moves."""
    folder = ResultsFolder(tmp_path_factory.mktemp("results"))
    run_scenario(
        "standard", {"locked": find_policy("locked")}, ["medium"], episodes=3, results=folder
    )
    return folder


@pytest.mark.slow
@FUZZ
@given(data=st.data())
def test_damaged_results(results: ResultsFolder, data: st.DataObject) -> None:
    (path,) = results.path.glob("runs/*.json")
    original = path.read_bytes()
    path.write_bytes(data.draw(damaged(original)))
    try:
        check(results.runs)
    finally:
        path.write_bytes(original)
