"""``pter speed``: the simulator's speed, as ratios to peers measured in the same run."""

from typing import TYPE_CHECKING

from pter_gym._internal.lazy import lazy_names

if TYPE_CHECKING:
    from pter_gym.tools.speed.measurement import Plan, Speed, make_plan, measure
    from pter_gym.tools.speed.report import as_json, notes, tables

__all__ = ["Plan", "Speed", "as_json", "make_plan", "measure", "notes", "tables"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "pter_gym.tools.speed.measurement": (
            "Plan",
            "Speed",
            "make_plan",
            "measure",
        ),
        "pter_gym.tools.speed.report": (
            "as_json",
            "notes",
            "tables",
        ),
    },
)
