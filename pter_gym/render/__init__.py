"""Pictures of a PTER at work, drawn with pygame: needs the extra ``render``."""

from pter_gym.render.viewer import Mode, Viewer

__all__ = ["Mode", "Viewer"]
