"""The order of a substep's stages: the one list that simulation and derivatives follow."""

from pter_gym._compiled.compiler import inlined

DRIFT, KICK = "drift", "kick"
HALF, WHOLE = 0.5, 1.0

ORDER = ((DRIFT, HALF), (KICK, WHOLE), (DRIFT, HALF))
"""Stages of a substep, each with the share of the substep's time that it stands for.

There is one kick, a whole one. If a substep begins and ends with half a drift, those of two
substeps join to a whole one, so a control step of n substeps is ½ (kick drift)ⁿ⁻¹ kick ½.
"""

_JOINS = ORDER[0][0] == ORDER[-1][0]

CYCLE = len(ORDER) - _JOINS
"""Stages from one kick to the next."""

_KICK_AT = ORDER.index((KICK, WHOLE))

KICK_FIRST = _KICK_AT == 0
"""Whether a control step begins with a kick, whose load no drift of that step has brought up."""

DRIFTS_WHOLE = (DRIFT, WHOLE) in ORDER
"""Whether a substep by itself has whole drifts."""


@inlined
def stage_count(substeps: int) -> int:
    """Return how many stages a control step has."""
    return substeps * CYCLE + _JOINS


@inlined
def is_kick(stage: int) -> bool:
    """Return whether a stage of a control step, by its number, is a kick and not a drift."""
    return stage % CYCLE == _KICK_AT


@inlined
def is_whole(stage: int, substeps: int) -> bool:
    """Return whether a drift, by its number, stands for a whole substep and not for half of one."""
    return (stage > 0) & (stage < substeps * CYCLE) if _JOINS else True
