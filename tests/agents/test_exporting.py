"""A policy in a folder of its own: whole or not at all, and a stranger's text stays text."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pter_agents import runs
from pter_agents.exporting import export
from pter_agents.runs import RunFolder
from pter_agents.settings import TrainingArguments, load_settings
from pter_gym.errors import DataError, StorageError
from pter_gym.policies import read_policy, write_policy

ODD = "x`\n\n# Certified <script>alert(1)</script>\x1b[2J"


def stranger(folder: Path, **about: Any) -> Path:
    """A policy's file with another account of its training."""
    policy = read_policy("ppo-standard")
    return write_policy(replace(policy, about=dict(policy.about) | about), folder / "odd")


def test_a_strangers_text_has_no_meaning_in_the_card(tmp_path: Path) -> None:
    about = dict.fromkeys(("algorithm", "corrects", "scenario", "command", "steps"), ODD)
    odd = stranger(tmp_path, **about, versions={ODD: ODD}, config={ODD: [ODD]})
    card = export(odd, tmp_path / "out").with_name("README.md").read_text("utf-8")
    assert "<script>" not in card
    assert "\x1b" not in card
    assert [line for line in card.splitlines() if line.startswith("#")] == ["# odd"]
    assert all(line.count("`") % 2 == 0 for line in card.splitlines() if "```" not in line)


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"validation": {"fast": {}}}, "validation"),
        ({"validation": {"medium": {"path_error_m": "0.1"}}}, "validation"),
        ({"validation": {"medium": 3}}, "validation"),
        ({"validation": [1]}, "validation"),
        ({"config": 3}, "config"),
        ({"versions": "1.0"}, "versions"),
    ],
)
def test_an_account_of_another_form_is_refused(
    about: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=message):
        export(stranger(tmp_path, **about), tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_an_export_that_fails_leaves_the_older_one_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export("ppo-standard", tmp_path / "out", name="mine")
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert set(before) == {"README.md", "mine.safetensors"}
    done: list[int] = []

    def full(file: int) -> None:
        done.append(file)
        if len(done) == 2:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="No space left"):
        export("residual", tmp_path / "out", name="mine")
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@pytest.mark.agents
def test_a_card_has_the_versions_of_the_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    policy, settings = read_policy("ppo-standard"), load_settings("ppo")
    arguments = TrainingArguments(
        algorithm="ppo", scenario="standard", pace="medium", steps=64, seed=0, settings=settings
    )
    folder, now = RunFolder(tmp_path / "run"), runs.versions_now()
    folder.path.mkdir()
    folder.begin(arguments, policy.interface)
    assert folder.read() == (arguments, policy.interface)
    folder.resume()
    assert folder.versions() == now
    monkeypatch.setattr(runs, "versions_now", lambda: now | {"numba": "99.0"})
    folder.resume()
    folder.resume()
    (told,) = caplog.messages
    assert f"numba 99.0 for {now['numba']}" in told
    monkeypatch.setattr(runs, "versions_now", lambda: dict.fromkeys(now, "0"))  # the export's
    layers = (
        {f".weights.policy[{k}][0]": weight.T.copy(), f".weights.policy[{k}][1]": bias}
        for k, (weight, bias) in enumerate(policy.layers)
    )
    folder.save(64, {name: array for each in layers for name, array in each.items()})
    file = export(folder.path, tmp_path / "mine")
    assert read_policy(file).about["versions"] == now | {"numba": f"{now['numba']}, then 99.0"}
    assert f"`numba {now['numba']}, then 99.0`" in file.with_name("README.md").read_text("utf-8")


def test_leftovers_of_a_killed_export_are_no_other_files(tmp_path: Path) -> None:
    (tmp_path / ".0123456789abcdef.tmp").touch()
    file = export("ppo-standard", tmp_path, name="mine")
    assert {path.name for path in tmp_path.iterdir()} == {"README.md", file.name}
