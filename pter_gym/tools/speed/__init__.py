"""``pter speed``: the simulator's speed, as ratios to peers measured in the same run."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.tools.speed.measurement import Plan, Speed, make_plan, measure
    from pter_gym.tools.speed.report import as_json, notes, tables

__all__ = ["Plan", "Speed", "as_json", "make_plan", "measure", "notes", "tables"]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "measurement": ["Plan", "Speed", "make_plan", "measure"],
        "report": ["as_json", "notes", "tables"],
    },
)
