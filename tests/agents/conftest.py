"""Trainings of tests are small: few worlds tell what inputs are like, and torch's threads are as before."""

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def quick_preparation(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    torch = pytest.importorskip("torch")
    prepare = pytest.importorskip("pter_agents.prepare")
    monkeypatch.setattr(prepare, "SAMPLE_WORLDS", 16)
    monkeypatch.setattr(prepare, "SAMPLE_STEPS", 20)
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)
