"""What trains or tunes never reads the stored evaluation episodes."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from pter_gym.benchmark.episodes import FOLDER

GUARD = f"""
import json, sys, traceback

def guard(event, arguments):
    if event == "open" and {str(FOLDER)!r} in str(arguments[0]):
        raise RuntimeError("evaluation episodes were read")

sys.addaudithook(guard)
errors = {{}}
for entry, code in json.loads(sys.argv[1]).items():
    errors[entry] = ""
    try:
        exec(code, {{}})
    except Exception:
        errors[entry] = traceback.format_exc()
print(json.dumps(errors))
"""

ENTRIES = {
    "the draws of each scenario": """
from pter_gym.scenarios import SCENARIOS
for scenario in SCENARIOS.values():
    scenario.draws.pairs(3, pace="slow")
""",
    "the environments": """
import gymnasium, pter_gym
gymnasium.make("PTER/Everything-v0", contexts=3).reset(seed=0)
gymnasium.make_vec("PTER/Everything-v0", num_envs=3, contexts=3).reset(seed=0)
""",
    "recorded episodes": """
from pter_gym.tools.datasets.recording import record_transitions
record_transitions("everything", "expert", 1)
""",
}

if not find_spec("pter_gym.tools.datasets"):
    del ENTRIES["recorded episodes"]

EPISODES = """
from pter_gym.benchmark.episodes import load_episodes
load_episodes("standard", "slow")
"""


@pytest.fixture(scope="module")
def errors() -> dict[str, str]:
    """What went wrong with each entry point, and with the episodes themselves, in one process."""
    codes = {**ENTRIES, "the episodes": EPISODES}
    found = subprocess.run(
        [sys.executable, "-c", GUARD, json.dumps(codes)], capture_output=True, text=True, check=True
    )
    return json.loads(found.stdout)


@pytest.mark.parametrize("entry", ENTRIES)
def test_training_draws_never_read_the_evaluation_episodes(
    entry: str, errors: dict[str, str]
) -> None:
    assert not errors[entry]


def test_the_guard_notices_reads_of_the_evaluation_episodes(errors: dict[str, str]) -> None:
    assert "evaluation episodes were read" in errors["the episodes"]
    assert Path(FOLDER).is_dir()
