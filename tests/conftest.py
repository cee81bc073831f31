"""Kernels are compiled before the workers of pytest-xdist start; slow tests come first."""

import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import hypothesis
import pytest

# no test judges how long something takes
hypothesis.settings.register_profile("gate", deadline=None)
hypothesis.settings.load_profile("gate")
# before NumPy: else each worker's linear algebra waits for all cores
os.environ.setdefault("OMP_NUM_THREADS", "1")
# those of pter_agents.ppo, for whatever uses JAX first
os.environ.setdefault("JAX_NUM_CPU_DEVICES", "2")

try:
    if version("jaxlib").startswith("0.10."):  # a flag that it does not know ends the process
        os.environ.setdefault(  # a third of the time to compile, which is most of what tests take
            "XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
        )
except PackageNotFoundError:
    pass


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Without workers, the first test that needs a kernel compiles it."""
    if session.config.getoption("numprocesses", None):
        import kernels

        kernels.compile_all()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``-m smoke``, import only files that have such tests."""
    if config.option.markexpr == "smoke" and collection_path.suffix == ".py":
        return "mark.smoke" not in collection_path.read_text("utf-8") or None
    return None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture
def few_hands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a search for the worst hand try fewer."""
    from pter_gym.benchmark.worst_hand import random_hands

    monkeypatch.setattr("pter_gym.benchmark.worst_hand.RANDOM", 128)
    monkeypatch.setattr("pter_gym.benchmark.worst_hand.SEARCHED", 256)
    random_hands.cache_clear()
