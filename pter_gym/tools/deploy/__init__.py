"""Policies for real machines, as C99 without libraries and as ONNX; arm and policies as FMUs."""

from pter_gym.tools.deploy.c_program import Source, source_of
from pter_gym.tools.deploy.description import Variable
from pter_gym.tools.deploy.fmu import Unit, arm_unit, find_unit, policy_unit, unit_of
from pter_gym.tools.deploy.onnx_graph import write_onnx

__all__ = [
    "Source",
    "Unit",
    "Variable",
    "arm_unit",
    "find_unit",
    "policy_unit",
    "source_of",
    "unit_of",
    "write_onnx",
]
