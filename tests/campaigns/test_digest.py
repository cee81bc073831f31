"""A digest of all bits of 1,024 worlds on each scenario: a refactoring keeps them.

    python tests/campaigns/test_digest.py      stores the digests of this computer in digests.json

Sine, cosine, exponential and logarithm are those of the computer's mathematical library, whose last
bits depend on library and processor, so the digests hold where these functions give the same bits;
elsewhere the test skips.
"""

import hashlib
import json
import math
import platform
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import pter_gym  # noqa: F401

STORED = Path(__file__).with_name("digests.json")
SCENARIOS = ("Standard", "Paths", "Materials", "Hands", "Tremor", "Everything")
WORLDS, STEPS = 1024, 400


def digest(scenario: str) -> str:
    """Hash observations, rewards and ends of worlds under slow random voltages."""
    envs = gymnasium.make_vec(f"PTER/{scenario}-v0", num_envs=WORLDS)
    found, rng = hashlib.sha256(), np.random.default_rng(5)
    found.update(np.ascontiguousarray(envs.reset(seed=3)[0]).tobytes())
    actions = np.zeros((WORLDS, 4), np.float32)
    for _ in range(STEPS):
        actions = np.clip(0.9 * actions + 0.3 * rng.standard_normal((WORLDS, 4)), -1, 1).astype(
            np.float32
        )
        for part in envs.step(actions)[:4]:
            found.update(np.ascontiguousarray(part).tobytes())
    envs.close()
    return found.hexdigest()[:24]


def mathematics() -> str:
    """Return a hash of what the mathematical library gives."""
    points = np.random.default_rng(0).uniform(0.0, 10.0, 2000).tolist()
    values = [function(x) for function in (math.sin, math.cos, math.exp, math.log) for x in points]
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()[:24]


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(x, marks=() if x in ("Paths", "Tremor", "Everything") else pytest.mark.long)
        for x in SCENARIOS
    ],
)
def test_the_bits_are_those_that_are_stored(scenario: str) -> None:
    stored = json.loads(STORED.read_text("utf-8"))
    if stored["mathematics"] != mathematics():
        pytest.skip(f"stored on {stored['platform']}, whose mathematical library gives other bits")
    assert digest(scenario) == stored["digests"][scenario]


if __name__ == "__main__":
    here = f"{platform.system()}, {platform.machine()}, {' '.join(platform.libc_ver())}"
    digests = {each: digest(each) for each in SCENARIOS}
    content = {"platform": here, "mathematics": mathematics(), "digests": digests}
    STORED.write_text(json.dumps(content, indent=2) + "\n", "utf-8")
