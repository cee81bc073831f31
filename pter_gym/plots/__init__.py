"""Figures, drawn with Matplotlib. Nothing here touches pyplot's global state or needs a display."""

from pter_gym.internal.looks import looks
from pter_gym.plots.style import STYLE, save

__all__ = ["STYLE", "looks", "save"]
