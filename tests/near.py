"""The tests that CONTRIBUTING.md names for a file.

`python tests/near.py main` prints those of the files that differ from the branch.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).parents[1]


def guide() -> Iterator[tuple[str, list[str]]]:
    """Yield each file or pattern of the table, in `pter_gym` and without an ending, and its tests.

    A name without a folder is in the folder of the one before it.
    """
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    (table,) = re.findall(r"Run, in `tests` \|\n\|---\|---\|\n(.*?)\n\n", text, re.DOTALL)
    for names, run in re.findall(r"^\| (.*?) \| `(.*?)` \|$", table, re.MULTILINE):
        folder, tests = "", run.partition(" -")[0].split()
        for name in re.findall(r"`(.*?)`", names):
            folder = name.rpartition("/")[0] if "/" in name else folder
            yield f"{folder}/{name.rpartition('/')[2]}".lstrip("/"), tests


def named_for(file: str) -> set[str]:
    """Return the tests of a file of the repository, as the table has them; of a test, itself."""
    place = Path(file)
    if place.match("tests/**/test_*.py"):
        return {file.removeprefix("tests/")}
    within = file.removeprefix("pter_gym/").rpartition(".")[0]
    if place.suffix == ".md" or place.stem == "__init__":
        within = "__init__"
    elif within.startswith("tools/"):
        return {"/".join(within.split("/")[:2])}
    elif within.startswith("agents/pter_agents/"):
        within = "agents/pter_agents"
    return {test for name, tests in guide() if fnmatch(within, name) for test in tests}


def changed(branch: str) -> list[str]:
    """Return the files of the checkout that differ from where it left a branch."""

    def git(*arguments: str) -> list[str]:
        done = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True
        )
        return done.stdout.splitlines()

    (start,) = git("merge-base", branch, "HEAD")
    return [*git("diff", "--name-only", start), *git("ls-files", "--others", "--exclude-standard")]


def near(branch: str) -> list[str]:
    """Return the tests of all files that differ from a branch, as arguments of pytest."""
    places = {ROOT / "tests" / test for file in changed(branch) for test in named_for(file)}
    found = {place for place in places if place.exists()}
    return sorted(str(each) for each in found if not found & {*each.parents})


if __name__ == "__main__":
    print(*near(sys.argv[1]), sep="\n")  # noqa: T201
