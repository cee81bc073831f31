"""Numbers that pages say in words are those of the code."""

from pathlib import Path

import pytest

from pter_gym.benchmark.leaderboard import FULL
from pter_gym.benchmark.ranking import COMPLETION, PACE_ERROR
from pter_gym.benchmark.statistics import RESAMPLES
from pter_gym.engine.starts import COVERED
from pter_gym.envs.scenario import TRUNCATION_ERROR
from pter_gym.tasks.path_following import STARTS
from pter_gym.tasks.path_following.allowance import ALLOWANCE
from pter_gym.tasks.path_following.reward import ERROR_WIDTH, FASTEST, PERFECT

ROOT = Path(__file__).parents[2]
IN_TENTHS = {0.3: "three in ten", 0.4: "four in ten"}
EXPLORING = STARTS["path"]
SAID = {
    "docs/your-algorithm.md": [f"truncated {TRUNCATION_ERROR:g} m from it", f"`truncation_error={TRUNCATION_ERROR:g}`"],
    "docs/reward.md": [
        f"truncate an episode {TRUNCATION_ERROR:g} m from the path",
        f"exp(−|e| / {1000 * ERROR_WIDTH:g} mm)",
        f"tracking = {PERFECT:g} ·",
        f"between rest and {FASTEST:g} times the pace",
        f"first {100 * COVERED:g} % of the path, up to {1000 * EXPLORING.offset:g} mm beside it",
        f"{IN_TENTHS[EXPLORING.moving]} anywhere",
        f"{IN_TENTHS[EXPLORING.gripped]} at the start",
    ],
    "docs/scoring.md": [
        f"{ALLOWANCE:.3f} s at most",
        f"at least {100 * COMPLETION:g} % of the episodes",
        f"most {100 * PACE_ERROR:g} %",
        f"fewer than {FULL} episodes",
        f"95 % from {RESAMPLES}",
    ],
}


@pytest.mark.parametrize(("page", "said"), [(page, said) for page, all_said in SAID.items() for said in all_said])
def test_a_page_says_what_the_code_has(page: str, said: str) -> None:
    assert said in " ".join((ROOT / page).read_text("utf-8").split())
