"""Modules that have moved are found by their old names, and are the same modules."""

import subprocess
import sys
from importlib import import_module

import pytest

from pter_gym._moved import MOVED


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_gives_the_very_module(old: str):
    if old.endswith("sb3"):
        pytest.importorskip("stable_baselines3")
    assert import_module(old) is import_module(MOVED[old])


@pytest.mark.parametrize("old_first", [True, False])
def test_a_module_of_a_moved_package_loads_once(old_first: bool):
    names = ["pter_gym.experiments.claims", "pter_gym.paper.experiments.claims"]
    program = f"import sys, {', '.join(names if old_first else names[::-1])}\n"
    program += f"one, two = (sys.modules[name] for name in {names})\nassert one is two\n"
    program += f"assert one.__spec__.name == one.__name__ == {names[1]!r}\n"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_an_old_name_can_be_run():
    command = [sys.executable, "-m", "pter_gym.cli", "--version"]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout.startswith("pter ")


def test_an_unknown_module_of_a_moved_package_is_missing():
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        import_module("pter_gym.experiments.no_such_module")


PROMISED = """
import pter_gym
from pter_agents.exporting import export_run
from pter_agents.algorithms import load_settings
from pter_agents.training import PROGRESS, Arguments, train
from pter_agents.worlds import draws_for
from pter_gym import BASELINE, simulate
from pter_gym.benchmark import PACES, ResultsFolder, find_policy, leaderboards, run_scenario
from pter_gym.benchmark import run_standard_test, score_episodes
from pter_gym.benchmark.episodes import load_episodes
from pter_gym.benchmark.leaderboard import COMPLETION, FULL, PACE_ERROR, leaderboards, table
from pter_gym.benchmark.simulation import bind, simulate, time_limit
from pter_gym.benchmark.statistics import bootstrap_interval, difference_interval, probability_of_improvement
from pter_gym.controllers import Impedance, PerClutch, Policy, device
from pter_gym.envs.batch import Batch
from pter_gym.envs.single import PathFollowingEnv
from pter_gym.errors import ParameterError
from pter_gym.experiments import Setup, Study, check, reversals, time_constant_sweep, torque_curves
from pter_gym.operators import HumanArm, RecordedForces, read_forces
from pter_gym.params import BASELINE, Hand, with_friction
from pter_gym.paths import read_path
from pter_gym.paths.arcs import Arcs, Path, fit_arcs
from pter_gym.physics.clutch import PerClutch
from pter_gym.plots import paper
from pter_gym.plots.benchmark import error_against_time, tip_paths
from pter_gym.plots.leaderboard import error_against_pace, trajectories
from pter_gym.policies import read_policy
from pter_gym.randomisation import LogUniform, OneOf, Randomisation, Uniform, Vary
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from pter_gym.units import to_inch_pounds, to_inches
"""
"""What documents and notebooks of version 0.1.0 import."""


@pytest.mark.parametrize("statement", PROMISED.strip().splitlines())
def test_what_version_0_1_0_shows_still_imports(statement: str):
    if "pter_agents" in statement:
        pytest.importorskip("stable_baselines3")
    exec(statement, {})
