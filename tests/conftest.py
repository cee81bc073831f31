"""Kernels are compiled before the workers of pytest-xdist start; slow tests come first."""

import os

import hypothesis
import pytest

hypothesis.settings.register_profile(
    "gate", deadline=None
)  # no test judges how long something takes
hypothesis.settings.load_profile("gate")
os.environ.setdefault(
    "OMP_NUM_THREADS", "1"
)  # before NumPy: else each worker's linear algebra waits for all cores

os.environ.setdefault(
    "JAX_NUM_CPU_DEVICES", "2"
)  # those of pter_agents.ppo, for whatever uses JAX first


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Without workers, the first test that needs a kernel compiles it."""
    if session.config.getoption("numprocesses", None):
        import kernels

        kernels.compile_all()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
