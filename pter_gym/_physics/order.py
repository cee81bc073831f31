"""The order of a substep's stages, which simulation and derivatives follow: ½ drift, kick, ½ drift.

The half drifts of two substeps join to a whole one, so a control step of n substeps is
½ (kick drift)ⁿ⁻¹ kick ½.
"""

from pter_gym._compiled.compiler import inlined

CYCLE = 2
"""Stages from one kick to the next."""


@inlined
def stage_count(substeps: int) -> int:
    """Return how many stages a control step has."""
    return substeps * CYCLE + 1


@inlined
def is_kick(stage: int) -> bool:
    """Return whether a stage of a control step, by its number, is a kick and not a drift."""
    return stage % CYCLE == 1


@inlined
def is_whole(stage: int, substeps: int) -> bool:
    """Return whether a drift, by its number, stands for a whole substep and not for half of one."""
    return (stage > 0) & (stage < substeps * CYCLE)
