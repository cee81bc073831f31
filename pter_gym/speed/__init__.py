"""How fast the simulator is, as ratios against peers that are measured in the same run: ``pter speed``."""

from pter_gym.speed.report import Plan, Speed, make_plan, measure, notes, tables

__all__ = ["Plan", "Speed", "make_plan", "measure", "notes", "tables"]
