"""Policies for real machines: as C99 without libraries, and as ONNX."""

from pter_gym.tools.deploy.graph import write_onnx
from pter_gym.tools.deploy.program import Source, source_of

__all__ = ["Source", "source_of", "write_onnx"]
