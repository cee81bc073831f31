"""Figures, drawn with Matplotlib. Nothing here touches pyplot's global state or needs a display."""

from pter_gym.tools.figures import STYLE, looks, save

__all__ = ["STYLE", "looks", "save"]
