"""Every check of this project: `nox --list` names them, `nox -s lint` runs one, `bash .ci/run` all
that must hold.

Each works in a copy of what a commit of the present files would contain, so no cache or stray file
plays a part. Sessions with the tag `gate` must pass before a change is kept; those with the tag
`long` take longer."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import nox

nox.options.tags = ["gate"]

ROOT = Path(__file__).parent
PINNED = ("-c", str(ROOT / "constraints.txt"))
CORE = "not agents and not long"

OLD_GYMNASIUM = ("-W", "default")
"""Old releases of the dependencies warn about each other."""


def copy(session: nox.Session, name: str, *, keep: str = "") -> Path:
    """Make a copy of the checkout, in which nothing of an earlier one is kept but an environment."""
    place = session.cache_dir / name
    for old in place.glob("*"):
        if old.name != keep:
            shutil.rmtree(old) if old.is_dir() else old.unlink()
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout
    for file in filter(None, listed.decode().split("\0")):
        if (ROOT / file).is_file():  # a file may be deleted and not yet committed
            (place / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / file, place / file)
    return place


def readme_command(session: nox.Session, name: str) -> Path:
    """Type the command that README.md shows as NAME in a new copy, where `python3` is the Python that runs nox."""
    (command,) = re.findall(
        rf"<!-- command: {name} -->\n```sh\n(.*)\n```", (ROOT / "README.md").read_text("utf-8")
    )
    place = copy(session, name)
    with session.chdir(place):
        path = f"{sys.base_prefix}/bin{os.pathsep}{os.environ['PATH']}"
        session.run("sh", "-ec", command, env=reported(session) | {"PATH": path}, external=True)
    return place


def reported(session: nox.Session, part: str = "tests") -> dict[str, str]:
    """Return variables with which pytest writes a report, for `.ci/count.py`."""
    report = f"--junitxml={session.cache_dir / 'reports' / session.name / part}.xml"
    return {
        "PYTEST_ADDOPTS": f"{report} -p no:cacheprovider",
        "MPLBACKEND": "Agg",
        "SDL_VIDEODRIVER": "dummy",
    }


def workshop(session: nox.Session) -> Path:
    """Go to a copy with everything in its `.venv`, that of the tests if they have run; return where the tools are."""
    place, python = copy(session, "tests", keep=".venv"), f"{sys.base_prefix}/bin/python3"
    tools = place / ".venv" / "bin"
    if not tools.exists():
        session.run(python, "-m", "venv", "--without-pip", str(place / ".venv"), external=True)
    if not (tools / "sphinx-build").exists():
        install = (python, "-m", "pip", "--python", str(tools / "python"), "install", "-q", *PINNED)
        session.run(*install, "-e", f"{place}[agents,dev,docs,render,test]", external=True)
    session.chdir(place)
    return tools


def pytest_in_copy(
    session: nox.Session, *arguments: str, pins: tuple[str, ...] = PINNED, extras: str = "test"
) -> None:
    """Run tests in a new copy, in an environment of this session; `test` is what the core's tests need."""
    place = copy(session, session.name)
    session.install("-q", *pins, "-e", f"{place}[{extras}]")
    session.chdir(place)
    session.run("pytest", "-n", "auto", *arguments, env=reported(session))


def site(session: nox.Session, folder: str, *marks: str, **variables: str) -> None:
    """Build the site or, with marks of tests, open it in a browser."""
    tools, place = workshop(session), str(session.cache_dir / folder)
    build = (str(tools / "sphinx-build"), "-q", "--fail-on-warning", "docs", place)
    look = (str(tools / "pytest"), "-n", "0", *marks, "tests/website")
    session.run(
        *(look if marks else build),
        env=reported(session) | variables | {"PTER_SITE": place},
        external=True,
    )


def build(session: nox.Session) -> Path:
    """Return a folder with wheel and sdist."""
    session.install("-q", *PINNED, "build")
    session.run(
        "python",
        "-m",
        "build",
        "--outdir",
        session.create_tmp(),
        str(copy(session, "build")),
        silent=True,
    )
    return Path(session.create_tmp())


def package_works(session: nox.Session, suffix: str) -> None:
    """Install the built wheel or sdist alone, and use it away from the checkout."""
    session.chdir(build(session))
    session.install("-q", *PINNED, *map(str, Path.cwd().glob(f"pter_gym*{suffix}")))
    session.run(
        "python", "-c", "import pter_agents, pter_gym as p; print(p.__version__, p.__file__)"
    )
    options = (
        "--scenario",
        "everything",
        "--episodes",
        "20",
        "--paces",
        "slow",
        "--policies",
        "impedance",
    )
    session.run("pter", "benchmark", *options, "--out", "suite")


@nox.session(venv_backend="none", tags=["gate"])
def tests(session: nox.Session) -> None:
    """README's command that installs everything and runs the tests."""
    readme_command(session, "tests")


@nox.session(tags=["gate"])
def lint(session: nox.Session) -> None:
    """Style and format, by ruff."""
    session.install("-q", *PINNED, "ruff")
    session.run("ruff", "check", "--no-cache", ".")
    session.run("ruff", "format", "--no-cache", "--check", ".")


@nox.session(venv_backend="none", tags=["gate"])
def types(session: nox.Session) -> None:
    """Types, by pyright."""
    tools = workshop(session)
    session.run(str(tools / "pyright"), "--pythonpath", str(tools / "python"), external=True)


@nox.session(venv_backend="none", tags=["gate"])
def docs(session: nox.Session) -> None:
    """The site, without a warning; its notebooks are not run."""
    site(session, "site")


@nox.session(venv_backend="none", tags=["gate"])
def website(session: nox.Session) -> None:
    """The site in a browser; skips where none is installed."""
    site(session, "site", "-m", "not long")


@nox.session(venv_backend="none", tags=["gate"])
def benchmark(session: nox.Session) -> None:
    """README's command that installs and runs the benchmark, and how long the first step takes."""
    place = readme_command(session, "benchmark")
    session.run(
        str(place / ".venv" / "bin" / "python"), str(ROOT / ".ci" / "first_use.py"), external=True
    )


@nox.session(tags=["gate"])
def wheel(session: nox.Session) -> None:
    """The built wheel alone."""
    package_works(session, ".whl")


@nox.session(python=["3.12", "3.13"], tags=["long"])
def wheels(session: nox.Session) -> None:
    """The same wheel on the other versions of Python."""
    package_works(session, ".whl")


@nox.session(python="3.13", tags=["long"])
def newest(session: nox.Session) -> None:
    """The core's tests on the newest Python."""
    pytest_in_copy(session, "-m", CORE)


@nox.session(venv_backend="none", tags=["long"])
def docs_executed(session: nox.Session) -> None:
    """The site with what its notebooks print, and every page of it in a browser."""
    site(
        session,
        "site-long",
        PTER_DOCS_EXECUTE="1",
        PTER_TRAINING_STEPS="81920",
        PTER_NOTEBOOK_EPISODES="24",
        PTER_NOTEBOOK_TRIALS="30",
    )
    site(session, "site-long", "-m", "long or not long")


@nox.session(venv_backend="none", tags=["long"])
def long(session: nox.Session) -> None:
    """The tests marked `long`."""
    tools = workshop(session)
    whole = (
        "-n",
        "auto",
        "-m",
        "long",
        "--ignore=tests/agents/test_libraries.py",
    )  # `libraries` runs these
    session.run(str(tools / "pytest"), *whole, env=reported(session), external=True)


@nox.session(tags=["long"])
def libraries(session: nox.Session) -> None:
    """Other learning libraries; each trains for a minute."""
    files = ("tests/agents/test_libraries.py", "tests/agents/test_offline.py")
    pytest_in_copy(session, "-m", "long or not long", *files, extras="agents,libraries,test")


@nox.session(tags=["long"])
def lowest(session: nox.Session) -> None:
    """The core's tests with the lowest promised version of each dependency."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    promised = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    found = filter(None, (re.match(r"([\w-]+)>=([\w.]+)", each) for each in promised))
    versions = Path(session.create_tmp()) / "lowest.txt"
    versions.write_text("".join(f"{each[1]}=={each[2]}\n" for each in found), "utf-8")
    pytest_in_copy(session, "-m", CORE, *OLD_GYMNASIUM, pins=("-c", str(versions)))


@nox.session(tags=["long"])
def ray(session: nox.Session) -> None:
    """The example for more than one machine."""
    place = copy(session, "ray")
    session.install("-q", *PINNED, "-e", str(place), "ray==2.60.0")
    session.run("python", str(place / "examples" / "ray_rollouts.py"), "--worlds", "16")


@nox.session(tags=["long"])
def sdist(session: nox.Session) -> None:
    """The built sdist alone."""
    package_works(session, ".tar.gz")


@nox.session(tags=["long"])
def metadata(session: nox.Session) -> None:
    """What PyPI and conda-forge read: metadata of wheel and sdist, and the recipe, by their own tools."""
    session.install("-q", "twine==7.0.0", "py-rattler-build==0.73.0")
    session.run("twine", "check", "--strict", *map(str, build(session).glob("pter_gym*")))
    render = "import sys, rattler_build as r; r.Stage0Recipe.from_file(sys.argv[1]).render()"
    session.run("python", "-c", render, str(ROOT / "docs" / "conda" / "recipe.yaml"))
