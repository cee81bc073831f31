"""How fast the simulator is, as ratios against peers that are measured in the same run: ``pter speed``."""

from pter_gym.tools.speed.measurement import Plan, Speed, make_plan, measure
from pter_gym.tools.speed.report import as_json, notes, tables

__all__ = ["Plan", "Speed", "as_json", "make_plan", "measure", "notes", "tables"]
