"""Sizes and colours of the picture."""

from pter_gym.internal import palette

WIDTH = 840
HEIGHT = 600
PANEL_WIDTH = 300
MARGIN = 16

TILE_WIDTH = 320
TILE_HEIGHT = 240

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

TITLE = 20
BODY = 17
SMALL = 15
