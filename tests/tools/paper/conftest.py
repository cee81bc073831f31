import pytest

from pter_gym.tools.paper.experiments import Experiments


@pytest.fixture(scope="session")
def experiments() -> Experiments:
    """The paper's experiments with the shipped parameters, each made once."""
    return Experiments()
