"""What lies in a folder of results that somebody sends, and what policies leave for each other, has no effect."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pter_gym._commands import main as cli
from pter_gym.benchmark import Isolated, ResultsFolder, run_scenario
from pter_gym.errors import ParameterError, PolicyError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

MODULE = "benchmark.isolated_policies"
OBS = np.zeros((3, len(observation_layout(BASELINE, "torque"))), np.float32)
RIDE = ("benchmark", "--scenario", "standard", "--paces", "brisk", "--episodes", "1", "--no-film", "--out", "more")

RAN = "import pathlib; (pathlib.Path(__file__).parent / 'ran').open('a').write(__name__ + '\\n')\n"
NAMES = ("sitecustomize", "usercustomize", "numpy", "numba", "rich", "tyro", "matplotlib", "pter_gym", "filelock")
MINE = "import numpy as np\n\ndef release(obs):\n    return np.zeros((len(obs), 4))\n"


@pytest.fixture(scope="module")
def received(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with modules, settings and a plug-in that act as soon as anything reads them."""
    results = ResultsFolder(tmp_path_factory.mktemp("received"))
    run_scenario("standard", ["free"], ["brisk"], episodes=1, results=results)
    results.summarise()
    for name in (*sys.stdlib_module_names, *NAMES, "evil"):
        (results.path / f"{name}.py").write_text(RAN)
    (results.path / "mine.py").write_text(MINE)
    (results.path / ".numba_config.yaml").write_text("cache_dir: ./compiled\n")
    plug_in = results.path / "evil-1.dist-info"
    plug_in.mkdir()
    (plug_in / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1\n")
    (plug_in / "entry_points.txt").write_text("[pter.pictures]\nscenario = evil:draw\n")
    return results.path


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ("verify", "."),
        (*RIDE, "--policies", "free"),
        (*RIDE, "--policies", "mine:release", "--isolated"),
        ("watch", "free", "--csv", "free.csv"),
    ],
)
def test_nothing_in_the_present_folder_runs_but_a_policy_that_is_named(command: Sequence[str], received: Path) -> None:
    ran = received / "ran"
    ran.unlink(missing_ok=True)
    pter = [sys.executable, "-P", "-m", "pter_gym._commands.main"]
    done = subprocess.run([*pter, *command], cwd=received, capture_output=True, text=True, check=False)
    assert not ran.exists(), ran.read_text()
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (received / "compiled").exists(), "numba would unpickle what it finds there"


@pytest.mark.parametrize("name", ["runs", "runs/standard-brisk-free-1.json", "benchmark.json", ".lock"])
def test_a_link_is_not_written_through(name: str, tmp_path: Path) -> None:
    results, target = ResultsFolder(tmp_path / "received"), tmp_path / "kept"
    if name == "runs":
        target.mkdir()
    else:
        target.write_text("kept")
    (results.path / name).parent.mkdir(parents=True)
    (results.path / name).symlink_to(target)
    for write in (lambda: run_scenario("standard", ["free"], ["brisk"], episodes=1, results=results), results.make):
        with pytest.raises(ParameterError, match="results must be in a folder without symbolic links"):
            write()
    assert list(target.iterdir()) == [] if target.is_dir() else target.read_text() == "kept"
    if "/" not in name:
        with pytest.raises(ParameterError, match="without symbolic links"):
            results.summarise()


@pytest.fixture
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))


@pytest.mark.usefixtures("importable")
def test_what_a_policy_notes_the_next_does_not_find(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for place in ("HOME", "TMPDIR", "XDG_CACHE_HOME"):
        (tmp_path / place).mkdir()
        monkeypatch.setenv(place, str(tmp_path / place))
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        with Isolated(f"{MODULE}:by_notes") as policy:
            assert policy.act(OBS).max() == 0.0
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.usefixtures("importable")
def test_a_run_that_fails_uses_up_its_seed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also without ``--isolated``: on a seed that somebody gives, code has a process of its own."""
    command = ["benchmark", "--paces", "brisk", "--episodes", "1", "--no-film", "--out", str(tmp_path)]
    before = list(sys.path)
    assert cli.main([*command, "--policies", f"{MODULE}:dies", "--fresh", "7"]) == 2
    assert "has ended its process" in capsys.readouterr().err
    assert sys.path == before
    assert cli.main([*command, "--policies", f"{MODULE}:by_notes", "--fresh", "7"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "--fresh must be a seed of 'standard' that no isolated policy has ridden" in told
    assert ResultsFolder(tmp_path).runs() == ()
    with Isolated(f"{MODULE}:raises") as policy, pytest.raises(PolicyError, match="has failed"):
        run_scenario("standard", {"mine": policy}, ["brisk"], episodes=1, fresh=8, results=tmp_path)
    (run,) = run_scenario("standard", ["free"], ["brisk"], episodes=1, fresh=7, results=tmp_path)
    assert run.conditions.fresh == 7, "the package's own policies may ride it"
