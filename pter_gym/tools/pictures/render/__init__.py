"""Pictures and videos of a PTER at work: telemetry in, pixels out. A window needs pygame, from the extra ``render``."""

from pter_gym.tools.pictures.render.viewer import Mode, Viewer

__all__ = ["Mode", "Viewer"]
