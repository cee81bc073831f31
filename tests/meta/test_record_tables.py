"""The page on the environment says what the declarations say, and so does the docstring of the environment."""

import re

import pytest
import record_tables

from pter_gym.envs.single import PathFollowingEnv
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

TABLES = record_tables.tables()


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_what_the_script_writes(name: str):
    blocks = re.findall(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->\n", record_tables.PAGE.read_text("utf-8"), re.DOTALL)
    assert blocks == [TABLES[name]]


@pytest.mark.parametrize("name", TABLES)
def test_every_entry_has_a_unit_and_a_meaning(name: str):
    for line in TABLES[name].splitlines()[2:]:
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        assert all(cells)
        assert "{" not in line


def test_the_docstring_of_the_environment_names_every_entry_of_the_observation():
    (section,) = re.findall(r"## Observation Space(.*?)## ", PathFollowingEnv.__doc__ or "", re.DOTALL)
    named = [
        name
        for line in section.splitlines()
        if line.strip().startswith("| `")
        for name in re.findall(r"`(\w+)`", line.split("|")[1])
    ]
    assert tuple(named) == observation_layout(BASELINE, "force").names
