"""Trainings of tests are small: few worlds tell what inputs are like."""

import pytest


@pytest.fixture(autouse=True)
def quick_preparation(monkeypatch: pytest.MonkeyPatch) -> None:
    worlds = pytest.importorskip("pter_agents.worlds")
    monkeypatch.setattr(worlds, "SAMPLE_WORLDS", 16)
    monkeypatch.setattr(worlds, "SAMPLE_STEPS", 20)
