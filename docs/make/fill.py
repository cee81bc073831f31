"""Fill the tables of README.md and docs: each stands between `<!-- name -->` and `<!-- /name -->` in its page.

    python docs/make/fill.py                     what the code declares; a test checks that it is up to date
    python docs/make/fill.py --results FOLDER    the leaderboards; --score-first runs their benchmark, in six minutes
    python docs/make/fill.py --planned FOLDER    what planning reaches; docs/classical-control.md has the commands
    python docs/make/fill.py --offline FOLDER    docs/data.md, from the scripts in agents/stock/offline
    python docs/make/fill.py --data FOLDER       docs/data.md, from the data sets of `pter record`

FOLDER is what `--out` named; its `benchmark.json` is read. A table that is missing here is made by a study, which
CONTRIBUTING.md lists.
"""

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import boards
import declared
import made
import tyro
from pages import DOCS, ROOT, write_block

from pter_gym._compiled.records import layout_of
from pter_gym._engine.law import Memory
from pter_gym._engine.world import BASIC_ROWS, CONSTANT_ROWS, STORED_ROWS
from pter_gym.controllers._gains import Nominal
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, RewardWeights, Sensing, Starts

NUMBERS = ENVIRONMENT, TASK, WORLDS, CONSTANTS, LAWS = tuple(
    f"docs/{name}.md" for name in ("environment", "task", "worlds", "constants", "laws")
)
"""Pages of every number, with its unit and meaning."""

CLASSICAL, SUITE = "docs/classical-control.md", "docs/scenarios/index.md"
STOCK, AT_SCALE = ROOT / "agents" / "stock", ROOT / "agents" / "at_scale"


class Table(NamedTuple):
    """A table of a page.

    Attributes
    ----------
    page
        From the root of the checkout.
    name
        In its markers.
    make
        Returns its Markdown, from the folder that it is made of if there is one.
    """

    page: str
    name: str
    make: Callable[..., str]


def asked_for() -> Iterator[Table]:
    """Return the blocks that pages ask of `made`."""
    for page in sorted(DOCS.rglob("*.md")):
        for asked in re.findall(r"^<!-- made: (.+) -->$", page.read_text("utf-8"), re.MULTILINE):
            place = page.relative_to(ROOT).as_posix()
            yield Table(place, f"made: {asked}", partial(made.markdown, page, asked))


DECLARED = (
    *asked_for(),
    Table(ENVIRONMENT, "observation", declared.observation),
    Table(ENVIRONMENT, "context", declared.context),
    Table(ENVIRONMENT, "telemetry", partial(declared.entries_table, TELEMETRY)),
    Table(TASK, "reward", partial(declared.fields_table, RewardWeights)),
    Table(TASK, "task", partial(declared.fields_table, PathFollowing)),
    Table(TASK, "starts", partial(declared.fields_table, Starts)),
    Table(TASK, "sensing", partial(declared.fields_table, Sensing)),
    Table(WORLDS, "stored by every world", partial(declared.world_table, 0, BASIC_ROWS)),
    Table(WORLDS, "stored by some worlds", partial(declared.world_table, BASIC_ROWS, STORED_ROWS)),
    Table(CONSTANTS, "constants", partial(declared.world_table, STORED_ROWS, STORED_ROWS + CONSTANT_ROWS)),
    Table(LAWS, "memory", partial(declared.entries_table, layout_of(Memory))),
    Table(LAWS, "nominal", partial(declared.entries_table, layout_of(Nominal))),
    Table(LAWS, "gains", declared.gains),
    Table("docs/scoring.md", "scores of an episode", declared.scores),
    Table("docs/reproduction.md", "standard test", declared.standard_test),
    Table("README.md", "claims", declared.claims),
    *(
        Table("docs/your-algorithm.md", path.stem, partial(declared.script, path))
        for path in sorted(STOCK.glob("*.py"))
    ),
    *(Table("docs/at-scale.md", path.stem, partial(declared.script, path)) for path in sorted(AT_SCALE.glob("*.py"))),
)

SHOWN = "residual", "ppo-standard", "single-dof-tuned", "torque-feedback-tuned", "torque-feedback", "impedance"
"""Policies whose scores README shows."""

OF_FOLDER = {
    "results": (
        Table(
            "README.md",
            "board: standard",
            partial(boards.by_pace, scenario="standard", names=SHOWN),
        ),
        Table(SUITE, "suite", boards.suite),
        Table(SUITE, "board: everything", partial(boards.by_pace, scenario="everything")),
        Table(SUITE, "gap", partial(boards.gaps, scenario="standard")),
        *(
            Table(f"docs/scenarios/{each}.md", "scores", partial(boards.leaderboard, scenario=each))
            for each in SCENARIOS
        ),
        Table(CLASSICAL, "board: standard", boards.by_tuning),
        Table(CLASSICAL, "board: everything", partial(boards.classical, scenario="everything", details=True)),
        Table("docs/agents.md", "against tuned", boards.against_tuned),
        Table("docs/scoring.md", "first by", boards.first_by),
    ),
    "planned": (Table(CLASSICAL, "predictive", boards.predictive),),
    "offline": (Table("docs/data.md", "results", boards.by_seed),),
    "data": (Table("docs/data.md", "sets", boards.data_sets),),
}
"""By the option that names the folder."""


def score(results: Path) -> None:
    """Run the benchmark of the pages: all policies on the fresh episodes of all scenarios, and the stored of one."""
    from pter_gym._commands.main import main as pter
    from pter_gym.benchmark.tuned import TUNED
    from pter_gym.policies import shipped_policies

    policies = ",".join((*boards.LEFT_OUT, "impedance", "torque-feedback", *TUNED, *shipped_policies()))
    for scenario, *fresh in (["standard"], *([each, "--fresh", "derived"] for each in SCENARIOS)):
        if status := pter(
            ["benchmark", "--scenario", scenario, *fresh, "--no-film", "--policies", policies, "--out", str(results)]
        ):
            raise SystemExit(status)


def main(
    results: Path | None = None,
    planned: Path | None = None,
    offline: Path | None = None,
    data: Path | None = None,
    score_first: bool = False,
) -> None:
    """Fill the tables of what the code declares, and those made of the folders that are given."""
    folders = {"results": results, "planned": planned, "offline": offline, "data": data}
    if score_first and results is not None:
        score(results)
    for table in DECLARED:
        write_block(ROOT / table.page, table.name, table.make())
    for option, folder in folders.items():
        for table in OF_FOLDER[option] if folder is not None else ():
            write_block(ROOT / table.page, table.name, table.make(folder))
            print(f"{table.page}: {table.name}")


if __name__ == "__main__":
    tyro.cli(main)
