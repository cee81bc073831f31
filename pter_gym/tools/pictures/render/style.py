"""Colours of a picture, and its sizes of text [px at the default size]."""

from pter_gym._internal import palette

BACKGROUND = "#ffffff"
PANEL = "#f3f4f6"
CARD = "#ffffff"
GROOVE = "#e3e5e9"
INK = "#1f2328"
MUTED = "#646b75"
WORKSPACE = "#eff5fb"
WORKSPACE_EDGE = "#d3e3f1"
PATH = "#3b4048"
TRAIL = palette.PURPLE
FORCE = palette.GREEN
LINK_A = palette.BLUE
LINK_B = palette.ORANGE
PARALLEL_A = "#80b9d9"
PARALLEL_B = "#f3cf80"
VOLTS = palette.SKY_BLUE
TORQUE = palette.VERMILLION

TITLE, BODY, SMALL = 14, 12, 11
