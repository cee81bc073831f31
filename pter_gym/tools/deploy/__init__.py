"""Policies for real machines: as C99 without libraries, and as ONNX."""

from pter_gym.tools.deploy.c_program import Source, source_of
from pter_gym.tools.deploy.onnx_graph import write_onnx

__all__ = ["Source", "source_of", "write_onnx"]
