"""The page on bringing one's own algorithm shows the scripts, and of the results all seeds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from stock_pages import LONGEST, PAGE, SCRIPTS, read_page, read_scores, results_table, shown

from pter_gym.benchmark import ResultsFolder, run_scenario
from pter_gym.controllers import Free


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda script: script.stem)
def test_the_page_shows_what_the_scripts_are(script: Path) -> None:
    block = f"<!-- {script.stem} -->\n```python\n{shown(script)}```\n<!-- /{script.stem} -->\n"
    assert block in PAGE.read_text("utf-8")
    assert len(shown(script).splitlines()) <= LONGEST
    assert "Standard-v0" in shown(script)
    assert "from_sb3(" in shown(script)


def test_all_seeds_are_in_the_table_with_their_median(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    results.make()
    made = {"ppo-0": (0.03, 4), "ppo-1": (0.05, 2), "law": (0.04, 4)}
    for fresh, names in enumerate((["ppo-0"], ["ppo-1", "law"])):
        for run in run_scenario("standard", dict.fromkeys(names, Free()), fresh=fresh, episodes=4):
            error, arrives = made[run.conditions.policy]
            made_up = {"path_error_m": error, "completed": np.arange(4) < arrives}
            scores = {score: np.broadcast_to(made_up.get(score, 0.0), 4).astype(float) for score in run.scores}
            results.add(replace(run, scores=scores))
    table = results_table(read_scores(tmp_path))
    assert results_table(read_page(f"<!-- results -->\n{table}<!-- /results -->\n")) == table
    assert table.splitlines()[2:] == [
        "| `law` | 1 | 40.0 | 40.0 | 40.0 |",
        "| `law` | median | **40.0** | **40.0** | **40.0** |",
        "| `ppo` | 0 | 30.0 | 30.0 | 30.0 |",
        "| `ppo` | 1 | (50.0) 50 % | (50.0) 50 % | (50.0) 50 % |",
        "| `ppo` | median | **40.0** | **40.0** | **40.0** |",
    ]
