"""The page on bringing one's own algorithm shows the scripts, and of the results all seeds."""

import json
from pathlib import Path

import pytest
from stock_pages import LONGEST, PAGE, SCRIPTS, read_page, read_scores, results_table, shown

from pter_gym.benchmark import PACES
from pter_gym.benchmark.metrics import METRICS


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda script: script.stem)
def test_the_page_shows_what_the_scripts_are(script: Path) -> None:
    block = f"<!-- {script.stem} -->\n```python\n{shown(script)}```\n<!-- /{script.stem} -->\n"
    assert block in PAGE.read_text("utf-8")
    assert len(shown(script).splitlines()) <= LONGEST
    assert "Standard-v0" in shown(script)
    assert "from_sb3(" in shown(script)


def test_all_seeds_are_in_the_table_with_their_median(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    for name, fresh, error, arrives in (("ppo-0", 0, 0.03, 1.0), ("ppo-1", 1, 0.05, 0.5), ("law", 1, 0.04, 1.0)):
        for pace in PACES:
            scores = {**dict.fromkeys(METRICS, [0.0] * 4), "path_error_m": [error] * 4, "completed": [arrives] * 4}
            run = {"policy": name, "fresh": fresh, "pace": pace, "scores": scores}
            (tmp_path / "runs" / f"{name}-{pace}.json").write_text(json.dumps(run), "utf-8")
    table = results_table(read_scores(tmp_path))
    assert results_table(read_page(f"<!-- results -->\n{table}<!-- /results -->\n")) == table
    assert table.splitlines()[2:] == [
        "| `law` | 1 | 40.0 | 40.0 | 40.0 |",
        "| `law` | median | **40.0** | **40.0** | **40.0** |",
        "| `ppo` | 0 | 30.0 | 30.0 | 30.0 |",
        "| `ppo` | 1 | (50.0) 50 % | (50.0) 50 % | (50.0) 50 % |",
        "| `ppo` | median | **40.0** | **40.0** | **40.0** |",
    ]
