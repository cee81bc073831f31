import pytest

from pter_gym.tools.paper.study import Study


@pytest.fixture(scope="session")
def study() -> Study:
    """The paper's experiments with the package's own parameters, each made once."""
    return Study()
