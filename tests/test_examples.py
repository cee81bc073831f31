"""The scripts in examples run, and fit on a screen."""

from pathlib import Path

import pytest

from documents import run_program

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
MARKS = {"make_and_step": pytest.mark.smoke} | dict.fromkeys(
    ("fmu_hand", "gradients", "own_machine", "pid"), pytest.mark.long
)
"""The long ones compile what no other example needs."""

NEEDS = {"fmu_hand": "fmpy", "jax_env": "jax"}

SHORTER = {"predictive": {"TEMPERATURE = 64, 2": "TEMPERATURE = 16, 1", "episodes=5": "episodes=1"}}

RUN = [
    pytest.param(path, id=path.stem, marks=MARKS.get(path.stem, ()))
    for path in EXAMPLES
    if path.stem != "ray_rollouts" and not path.stem.startswith("sb3_")
]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_fits_on_a_screen(path: Path) -> None:
    """A planner on two."""
    assert len(path.read_text("utf-8").splitlines()) <= (100 if path.stem == "predictive" else 50)


@pytest.mark.slow
@pytest.mark.parametrize("path", RUN)
def test_an_example_runs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Ray's runs in an environment of its own; that of Stable-Baselines3 is README's."""
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    program = path.read_text("utf-8")
    for old, new in SHORTER.get(path.stem, {}).items():
        assert old in program
        program = program.replace(old, new)
    run_program([program], str(path), __file__=str(path))
    assert capsys.readouterr().out
