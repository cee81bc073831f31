"""What a law of one's own is written with."""

from pter_gym._compiled.compiler import compiled
from pter_gym._compiled.records import rows
from pter_gym._physics.clutch import PerClutch
from pter_gym.controllers._gains import MEMORY, Memory

__all__ = ["MEMORY", "Memory", "PerClutch", "compiled", "rows"]
