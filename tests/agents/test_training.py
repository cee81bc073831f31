"""PPO: a resumed training is the uninterrupted one, and what is exported acts."""

from pathlib import Path

import numpy as np
import pytest

from pter_agents.exporting import export
from pter_agents.runs import RunFolder
from pter_agents.settings import SMOKE, Arguments, load_settings
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.policies import read_policy

pytestmark = pytest.mark.agents


def arguments(steps: int, algorithm: str = "residual", **changes: object) -> Arguments:
    settings = load_settings(algorithm, **SMOKE, **changes)
    return Arguments(
        algorithm=algorithm,
        scenario="standard",
        pace="medium",
        steps=steps * settings.worlds * settings.steps,
        seed=1,
        settings=settings,
        checkpoint_every=1,
        validation_episodes=2,
    )


@pytest.mark.slow
def test_resumed_training_has_the_same_bits(tmp_path: Path) -> None:
    from pter_agents.training import train

    constant = {"learning_rate_end": 1e-3, "deviation_end": 0.3}
    train(arguments(2, **constant), tmp_path / "whole")
    train(arguments(1, **constant), tmp_path / "parts")
    train(arguments(2, **constant), tmp_path / "parts", resume=True)
    (steps, one), (others, two) = (RunFolder(tmp_path / name).load() for name in ("whole", "parts"))
    assert steps == others
    assert one.keys() == two.keys()
    for name, array in one.items():
        np.testing.assert_array_equal(array, two[name], err_msg=name)
    with pytest.raises(ParameterError, match="reach"):
        train(arguments(2, reach=3.0, **constant), tmp_path / "parts", resume=True)
    file = export(tmp_path / "whole", tmp_path / "mine", name="mine")
    assert {path.name for path in file.parent.iterdir()} == {"README.md", "mine.safetensors"}
    policy = read_policy(tmp_path / "mine")
    assert policy.about["steps"] == steps
    np.testing.assert_array_equal(policy.layers[0][0].T, one[".weights.policy[0][0]"])


def test_settings_are_checked() -> None:
    with pytest.raises(ParameterError, match="worlds"):
        load_settings("ppo", worlds=3)
    with pytest.raises(ParameterError, match="config"):
        load_settings("ppo", wolds=3)
    assert arguments(1).nominal == BASELINE
