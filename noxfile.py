"""Every check of this project: `nox --list` names them, `nox -s lint` runs one.

Each works in a copy of what a commit of the present files would contain, so no cache or stray file
plays a part. Sessions with the tag `gate` must pass before a change is kept; those with the tag
`long` take longer.
"""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from tempfile import gettempdir

import nox

nox.options.tags = ["gate"]

ROOT = Path(__file__).parent
PINNED = ("-c", str(ROOT / "constraints.txt"))
CORE = "not agents and not long"

OLD_GYMNASIUM = ("-W", "default")
"""Old releases of the dependencies warn about each other."""


def copy(session: nox.Session, name: str, *, keep: str = "") -> Path:
    """Make a fresh copy of the checkout that keeps nothing of an earlier one but ``keep``."""
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
    """Type the command that README.md shows as NAME in a new copy, with nox's Python."""
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
    """Go to a copy with everything installed, the tests' if they have run; return its tools."""
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
    """Run tests in a new copy and environment; the core's need the extra `test`."""
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


def install_hashed(session: nox.Session, name: str) -> None:
    """Install what `.ci/NAME.txt` lists, and nothing with other bytes."""
    session.install("-q", "--require-hashes", "-r", str(ROOT / ".ci" / f"{name}.txt"))


def build(session: nox.Session) -> Path:
    """Return a folder with wheel and sdist, after a look at what these are made of."""
    install_hashed(session, "build")
    place, out = copy(session, "build"), Path(session.create_tmp())
    command = ("build", "--no-isolation", "--outdir", str(out), str(place))
    session.run("python", "-m", *command, silent=True)
    check_sdist(session, place, max(out.glob("*.tar.gz"), key=os.path.getmtime))
    return out


def check_sdist(session: nox.Session, commit: Path, archive: Path) -> None:
    """End unless an sdist has all files of a commit: its tests read files from everywhere."""
    wanted = {file.relative_to(commit).as_posix() for file in commit.rglob("*") if file.is_file()}
    with tarfile.open(archive) as files:
        found = {each.name.partition("/")[2] for each in files if each.isfile()} - {"PKG-INFO"}
    if wanted != found:
        session.error(f"{archive.name} and the commit differ in {sorted(wanted ^ found)}")


def package_works(session: nox.Session, suffix: str) -> None:
    """Install the built wheel or sdist alone, and use it away from the checkout."""
    session.chdir(build(session))
    session.install("-q", *PINNED, *map(str, Path.cwd().glob(f"pter_gym*{suffix}")))
    session.run("python", "-c", "import pter_agents, pter_gym as p; print(p.__version__)")
    options = "--scenario everything --episodes 20 --paces slow --policies impedance --out suite"
    session.run("pter", "benchmark", *options.split())


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
    """The site without a warning, its notebooks not run; opened in a browser if there is one."""
    site(session, "site")
    site(session, "site", "-m", "not long")


@nox.session(tags=["gate"])
def wheel(session: nox.Session) -> None:
    """The built wheel alone, with the sdist's tests; README's benchmark; a first step's time."""
    package_works(session, ".whl")
    session.install("-q", *PINNED, "pter-gym[test]")
    (archive,) = Path.cwd().glob("pter_gym*.tar.gz")
    shutil.unpack_archive(archive, "unpacked")
    session.chdir(Path("unpacked") / archive.name.removesuffix(".tar.gz"))
    session.run("pytest", "-m", "smoke", env=reported(session))
    place = readme_command(session, "benchmark")
    python = str(place / ".venv" / "bin" / "python")
    session.run(python, str(ROOT / ".ci" / "first_use.py"), external=True)


@nox.session(venv_backend="none", tags=["long"])
def long(session: nox.Session) -> None:
    """The tests marked `long`, and the site with what its notebooks print."""
    tools = workshop(session)
    options = ("-n", "auto", "-m", "long", "--ignore=tests/agents/test_libraries.py")
    session.run(str(tools / "pytest"), *options, env=reported(session, "long"), external=True)
    shorter = {"TRAINING_STEPS": "81920", "NOTEBOOK_EPISODES": "24", "NOTEBOOK_TRIALS": "30"}
    settings = {f"PTER_{name}": value for name, value in shorter.items()}
    site(session, "site-long", PTER_DOCS_EXECUTE="1", **settings)
    site(session, "site-long", "-m", "long or not long")


@nox.session(python=["3.11", "3.12", "3.13", "3.14"], tags=["long"])
def versions(session: nox.Session) -> None:
    """The core's tests with the lowest dependencies and on the two newest Pythons; else the wheel.

    A Python that this machine lacks is skipped.
    """
    if session.python == "3.11":
        pytest_in_copy(session, "-m", CORE, *OLD_GYMNASIUM, pins=("-c", lowest_pins(session)))
    elif session.python == "3.12":
        package_works(session, ".whl")
    else:
        pytest_in_copy(session, "-m", CORE)


def lowest_pins(session: nox.Session) -> str:
    """Write constraints with the lowest promised version of each dependency; return their path."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    promises = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    lowest = filter(None, (re.match(r"([\w-]+)>=([\w.]+)", promise) for promise in promises))
    path = Path(session.create_tmp()) / "lowest.txt"
    path.write_text(
        "".join(f"{name}=={version}\n" for name, version in map(re.Match.groups, lowest))
    )
    return str(path)


@nox.session(tags=["long"])
def libraries(session: nox.Session) -> None:
    """Other learning libraries, each of which trains for a minute."""
    files = ("tests/agents/test_libraries.py", "tests/agents/test_offline.py")
    pytest_in_copy(session, "-m", "long or not long", *files, extras="agents,libraries,test")


@nox.session(tags=["long"])
def packages(session: nox.Session) -> None:
    """The built sdist alone; what PyPI and conda-forge read of it; Ray."""
    package_works(session, ".tar.gz")
    session.install("-q", "py-rattler-build==0.73.0")
    install_hashed(session, "twine")
    session.run("twine", "check", "--strict", *map(str, build(session).glob("pter_gym*")))
    render = "import sys, rattler_build as r; r.Stage0Recipe.from_file(sys.argv[1]).render()"
    session.run("python", "-c", render, str(ROOT / "docs" / "conda" / "recipe.yaml"))
    place = copy(session, "ray")
    # the extra `rllib` of Ray wants another version of Gymnasium than is pinned
    rllib = (
        "ray==2.60.0",
        "dm-tree",
        "lz4",
        "ormsgpack",
        "pandas",
        "pyarrow",
        "pydantic",
        "requests",
    )
    session.install("-q", *PINNED, "-e", f"{place}[agents]", *rllib)
    outside = {"TMPDIR": gettempdir()}  # Ray's workers refuse a folder within an environment
    for program, *options in (
        ("examples/ray_rollouts.py",),
        ("agents/libraries/rllib_ppo.py", "--workers", "2", "--horizon", "32", "--steps", "2048"),
    ):
        session.run("python", str(place / program), "--worlds", "16", *options, env=outside)


@nox.session(venv_backend="none")
def near(session: nox.Session) -> None:
    """The tests that CONTRIBUTING.md names for the files changed since main, in this checkout."""
    found = str(session.run(sys.executable, "tests/near.py", "main", silent=True)).split()
    if not found:
        session.skip("no test is named for what has changed since main")
    session.run(sys.executable, "-m", "pytest", *found, *session.posargs)


@nox.session
def release(session: nox.Session) -> None:
    """Wheel and sdist of the version, checked, in `dist`; `-- vVERSION` is the tag they are for."""
    (version,) = re.findall(r'= "(.+)"', (ROOT / "pter_gym" / "_version.py").read_text("utf-8"))
    if f"\n## [{version}] - 20" not in (ROOT / "CHANGELOG.md").read_text("utf-8"):
        session.error(f"CHANGELOG.md must have a heading `## [{version}] - DATE`")
    if session.posargs not in ([], [f"v{version}"]):
        session.error(f"the tag of this version is v{version}, got {session.posargs[0]}")
    changed = subprocess.run(
        ["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, check=True
    )
    if changed.stdout:
        session.error("a release is made of a commit: some files differ from it")
    made = sorted(build(session).glob(f"pter_gym-{version}*"))
    install_hashed(session, "twine")
    session.run("twine", "check", "--strict", *map(str, made))
    (ROOT / "dist").mkdir(exist_ok=True)
    for file in made:
        shutil.copy2(file, ROOT / "dist")
        session.log(f"dist/{file.name}")
