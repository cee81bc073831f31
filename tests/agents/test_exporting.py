"""A policy in a folder of its own: whole or not at all, and a stranger's text stays text."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pter_agents.exporting import export
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
