"""The command line: help on one screen, examples that are understood, and errors."""

import re
import shlex
import subprocess
import sys
import warnings
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from pter_gym._commands.main import commands, load_command, main, parse
from pter_gym.benchmark import ResultsFolder
from pter_gym.envs import _computer
from pter_gym.policies.find import split

EXAMPLE = re.compile(r"Example: `?pter ([^\n`]+)")


@pytest.mark.parametrize("name", commands())
def test_the_example_in_a_help_is_understood(name: str) -> None:
    (found,) = EXAMPLE.findall(load_command(name).__doc__ or "")
    first, *arguments = shlex.split(found)
    assert first == name
    parse(name, load_command(name), arguments)


def test_help_shows_the_choices(capsys: pytest.CaptureFixture[str]) -> None:
    for line in ("--help", "help"):
        assert main([line]) == 0
        assert all(name in capsys.readouterr().out for name in ("benchmark",))
    for line in ("benchmark --help", "help benchmark"):
        with pytest.raises(SystemExit) as end:
            main(line.split())
        assert end.value.code == 0
        assert "slow|medium|brisk" in capsys.readouterr().out


@pytest.mark.parametrize(("quota", "cores"), [("150 50", 3), ("20 50", 1), ("max 50", 8)])
def test_a_container_has_the_cores_of_its_quota(
    quota: str, cores: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cpu.max").write_text(f"{quota}\n")
    monkeypatch.setattr(_computer, "CGROUP", tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert _computer.available_cores() == cores


REFUSED = ["benchmarl", "benchmark --policies impedence", "tune impedence", "reproduce fig6"]
REFUSED += ["benchmark --paces slw", "benchmark --path mien.csv", "benchmark --policies mine.toml"]


@pytest.mark.parametrize("line", REFUSED)
def test_an_error_is_one_line(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ")


MISTYPED = [
    *("benchmark --policies impedence", "benchmark --policies some/where", "benchmark --paces slw"),
    *(
        "benchmark --policies mine.toml",
        "benchmark --policies my.py:law",
        "benchmark --path my.csv",
    ),
    *("benchmark --path columns.csv", "tune impedence", "tune impedance --machine my.toml"),
    *("benchmark --machine my.toml", "benchmark --machine baselin"),
    *("watch impedence --out a.webp", "watch free --pace slw --out a.webp", "device my.toml"),
    *("hil impedence ./loop", "export impedence --c folder", "benchmark --path nopath"),
    *("tune impedance --path nopath", "watch free --path nopath --out a.webp"),
    *("benchmark --path millimetres.csv", "tune impedance --path millimetres.csv"),
    *("benchmark --hand my.toml", "tune impedance --hand tremor", "device baseline --hand my.toml"),
    *("watch free --hand my.toml --out a.webp", "train ppo --hand my.toml"),
    *("identify nofile", "identify columns.csv", "identify nofile --machine basline"),
]


def test_what_is_mistyped_is_told_before_anything_heavy_is_imported(tmp_path: Path) -> None:
    """Numba, SciPy and Matplotlib take seconds to import."""
    (tmp_path / "columns.csv").write_text("x,z\n0,0\n1,1\n")
    (tmp_path / "millimetres.csv").write_text("x,y\n-300,650\n0,650\n300,650\n")
    lines = [line for line in MISTYPED if line.partition(" ")[0] in commands()]
    program = (
        "import sys; from pter_gym._commands.main import main\n"
        f"for line in {lines}:\n"
        "    assert main(line.split()) == 2, line\n"
        "    heavy = {'numba', 'scipy', 'matplotlib', 'jax', 'torch'} & set(sys.modules)\n"
        "    assert not heavy, (line, heavy)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    assert found.returncode == 0, found.stderr
    assert found.stderr.count("error: ") == len(lines)


def test_a_laws_warning_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my.py").write_text("def law(obs):\n    return obs[:, :4] + 30.0\n")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        line = "benchmark --policies my.py:law --paces brisk --episodes 1 --no-film"
        assert main(line.split()) == 0
    told = capsys.readouterr().err.splitlines()
    assert [line for line in told if "warn" in line] == [
        "warning: law gives voltages beyond [0, 24] V, which are clipped"
    ]


def test_benchmark_takes_a_machine(tmp_path: Path) -> None:
    line = "benchmark --policies random --paces brisk --no-film --machine delrin_experimental"
    assert main([*line.split(), "--episodes", "2", "--out", str(tmp_path)]) == 0
    (run,) = ResultsFolder(tmp_path).runs()
    assert (run.scenario, run.seed) == ("standard-with-delrin_experimental", 0)


def test_help_survives_a_command_whose_package_is_gone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = EntryPoint("gone", "no_such_package.command:gone", "pter.commands")
    monkeypatch.setattr("pter_gym._commands.main.registered", lambda _: {"gone": gone})
    assert main(["--help"]) == 0
    assert "gone" in capsys.readouterr().out
    assert main(["gone"]) == 2
    assert "no_such_package" in capsys.readouterr().err


def test_the_path_of_a_file_may_have_commas(tmp_path: Path) -> None:
    file, other = tmp_path / "a,b.py", tmp_path / "c.py"
    file.touch()
    other.touch()
    for text in (str(file), f"{file}:law"):
        assert split(text) == [text]
    assert split(f"{other}:law, free,{other}:law") == [f"{other}:law", "free"]


def test_a_folder_may_have_commas(tmp_path: Path) -> None:
    (tmp_path / "runs, 1" / "c").mkdir(parents=True)
    policy, code = tmp_path / "runs, 1" / "mine.safetensors", tmp_path / "runs, 1" / "my,own.py"
    policy.touch()
    code.touch()
    for first in (policy, policy.with_suffix(""), policy.parent, f"{code}:law"):
        assert split(f"{first},impedance, {code}") == [str(first), "impedance", str(code)]
    assert split(f"{tmp_path}/none, 1/mine,free") == [f"{tmp_path}/none", "1/mine", "free"]


@pytest.mark.parametrize("name", commands())
@pytest.mark.parametrize("columns", [60, 80])
def test_a_help_fits_the_terminal(
    name: str, columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit):
        main([name, "--help"])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= columns
    told = " ".join((load_command(name).__doc__ or "").partition("Example:")[0].split())
    assert told in " ".join(printed.split())


TOLD = {
    "benchmark --episodes abc": "episodes must be a whole number, got 'abc'",
    "benchmark --smooth 2mm": "smooth must be a number, got '2mm'",
    "hil residual ./loop --deadline soon": "deadline must be a number, got 'soon'",
    "train ppo --steps 1e6": "steps must be a whole number, got '1e6'",
    "train": "algo must be given, one of ppo, residual, universal",
    "hil residual ./loop --scenario wall": "scenario must be among standard, paths, hands, ",
}


@pytest.mark.parametrize("line", TOLD)
def test_a_refused_argument_is_named_with_what_fits(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    assert capsys.readouterr().err.startswith(f"error: {TOLD[line]}")


UNKNOWN = ["benchmark --scenario standad", "benchmark --polices free", "benchmark residual"]
UNKNOWN += ["export impedance"] * ("export" in commands())


@pytest.mark.parametrize("line", UNKNOWN)
def test_an_unknown_choice_is_refused_with_the_choices(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line.split()) == 2
    meant = {"standad": "standard", "free": "--policies"}
    meant |= {"residual": "--policies residual", "impedance": "--c"}
    assert meant[line.rsplit(maxsplit=1)[-1]] in capsys.readouterr().err


MISSING = {"watch": "residual", "tune": "impedance", "device": "particle-brake", "train": "ppo"}


@pytest.mark.parametrize("name", [name for name in MISSING if name in commands()])
def test_a_missing_argument_lists_the_names_that_fit(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert MISSING[name] in line


@pytest.mark.parametrize("name", commands())
def test_a_help_shows_no_default_that_is_none(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert not re.search(r"None|\(default:\s*\)", capsys.readouterr().out)


def recorded(file: Path, unit: float = 1.0) -> str:
    """Write a path as a recorder has it, with 2 mm of noise."""
    along, noise = np.linspace(-0.3, 0.3, 200), np.random.default_rng(1).normal(0, 2e-3, (2, 200))
    points = np.array([along, 0.65 + 0.05 * np.sin(7.0 * along)]) + noise
    np.savetxt(file, points.T / unit, delimiter=",", header="x,y", comments="")
    return str(file)


def test_a_noisy_path_is_told_and_smoothed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = [
        "watch",
        "residual",
        "--machine",
        "baseline",
        "--csv",
        str(tmp_path / "a.csv"),
        "--path",
    ]
    path = recorded(tmp_path / "noisy.csv")
    assert main([*line, path]) == 0
    printed = capsys.readouterr().out
    assert "--smooth" in printed.partition("next:")[0]
    assert "--smooth" in printed.partition("next:")[2]
    assert "--machine baseline" in printed.partition("next:")[2]
    assert main([*line, path, "--smooth", "3"]) == 0
    printed = capsys.readouterr().out
    assert "arrived" in printed
    assert "bends" not in printed
    assert main([*line, recorded(tmp_path / "mm.csv", unit=1e-3)]) == 2
    assert "0.16 to 1 m" in capsys.readouterr().err


@pytest.mark.smoke
def test_benchmark_prints_a_table_and_writes_runs_that_have_the_same_bits_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "benchmark --policies free, locked --paces brisk --episodes 2 --details --no-film --out"
    runs: list[list[bytes]] = []
    for out in ("first", "second"):
        assert main([*line.split(), str(tmp_path / out)]) == 0
        runs.append([file.read_bytes() for file in sorted((tmp_path / out / "runs").iterdir())])
    assert len(runs[0]) == 2
    assert runs[0] == runs[1]
    printed = capsys.readouterr().out
    assert printed.startswith("standard, 2 test episodes: path error [mm]")
    assert "peak acc." in printed


def test_a_benchmark_at_the_speed_of_a_named_pace_has_its_film(tmp_path: Path) -> None:
    arguments = ["--policies", "free", "--paces", "0.25", "--episodes", "2", "--out", str(tmp_path)]
    assert main(["benchmark", *arguments]) == 0
    assert list(tmp_path.glob("*.webp"))
