"""Policies times scenarios: the paper's standard test and its scores."""

from pter_gym.benchmark.metrics import Score, score
from pter_gym.benchmark.standard import Result, Run, find_controller, run_standard_test

__all__ = ["Result", "Run", "Score", "find_controller", "run_standard_test", "score"]
