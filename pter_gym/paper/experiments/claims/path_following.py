"""Claims of sections IV-A, IV-C.1 and IV-C.2: the standard test over time constants and materials, and Table I."""

import math
from functools import partial

from pter_gym.paper.experiments import measures
from pter_gym.paper.experiments.claims.statement import (
    CLEAR,
    COLUMNS,
    FITTED_TREND,
    NAMES,
    TABLE_TOLERANCE,
    TRADE_OFF,
    TREND,
    Statement,
)
from pter_gym.paper.experiments.measures import BASELINE, EXPERIMENTAL, THEORETICAL
from pter_gym.paper.experiments.time_constants import PAPER_TABLE

FROM_TABLE = "Follows from two fitted entries of Table I."


def _table_statements() -> tuple[Statement, ...]:
    return tuple(
        Statement(
            id=f"table1-{model}-{name.replace(' ', '-')}".replace("_", "-"),
            section="IV-C.2, Table I",
            figure="table1",
            claim=f"With {NAMES[model]} the average {name} is {PAPER_TABLE[model][column]:g} {unit}.",
            measured=f"average {name} over the time constants",
            measure=partial(measures.table_entry, model=model, column=column),
            unit=unit,
            at_least=PAPER_TABLE[model][column] * (1.0 - TABLE_TOLERANCE),
            at_most=PAPER_TABLE[model][column] * (1.0 + TABLE_TOLERANCE),
            given=True,
            note=f"Fitted; {TABLE_TOLERANCE:.0%} off counts as met.",
            reason=TRADE_OFF,
        )
        for model in PAPER_TABLE
        for column, (name, unit) in enumerate(COLUMNS)
    )


def _trend(quantity: str, figure: str, claim: str, *, rises: bool = True) -> Statement:
    return Statement(
        id=f"trend-{quantity.replace('_', '-')}",
        section="IV-C.1",
        figure=figure,
        claim=claim,
        measured=f"rank correlation of {quantity.replace('_', ' ')} and time constant",
        measure=partial(measures.trend_over_time_constant, quantity=quantity),
        at_least=TREND if rises else -math.inf,
        at_most=math.inf if rises else -TREND,
        given=True,
        note=FITTED_TREND,
        reason=TRADE_OFF,
    )


PATH_FOLLOWING: tuple[Statement, ...] = (
    Statement(
        id="disturbance",
        section="IV-A, Eq. 5",
        figure="fig7",
        claim="The force across the path is Fmax/5 times a sum of five sines of 0.5 to 8 Hz.",
        measured="largest difference of the hand's force from Eq. 5, relative to Fmax",
        measure=measures.disturbance_deviation,
        at_most=1e-9,
        given=True,
        note="The paper's definition, put into the task.",
    ),
    _trend("position_error", "fig7", "The path-average position error tends to grow with the time constant."),
    _trend("peak_acceleration", "fig8", "The peak acceleration of the tip falls with the time constant.", rises=False),
    _trend("path_length", "fig8", "The path of the tip gets longer with the time constant."),
    _trend("tip_speed", "fig8", "The average tip speed grows with the time constant."),
    *_table_statements(),
    Statement(
        id="similar-errors",
        section="IV-C.2",
        figure="table1",
        claim="Baseline and experimental Delrin have similar position errors.",
        measured="experimental Delrin relative to the baseline",
        measure=partial(measures.table_ratio, model=EXPERIMENTAL, other=BASELINE, column=0),
        at_least=1.0 - 2.0 * CLEAR,
        at_most=1.0 + 2.0 * CLEAR,
        given=True,
        note=FROM_TABLE,
    ),
    *(
        Statement(
            id=f"{model.removeprefix('delrin_')}-faster-{name.split()[-1]}",
            section="IV-C.2",
            figure="table1",
            claim=f"The average {name} is higher with {NAMES[model]} than with the present clutches.",
            measured="relative to the present clutches",
            measure=partial(measures.table_ratio, model=model, other=BASELINE, column=column),
            at_least=1.0 + CLEAR,
            given=True,
            note=FROM_TABLE,
        )
        for model in (EXPERIMENTAL, THEORETICAL)
        for column, (name, _) in enumerate(COLUMNS)
        if column > 0
    ),
    *(
        Statement(
            id=f"theoretical-better-than-{other.removeprefix('delrin_')}",
            section="IV-C.2",
            figure="table1",
            claim=f"Theoretical Delrin follows the path better than {NAMES[other]}.",
            measured="position error relative to the other material",
            measure=partial(measures.table_ratio, model=THEORETICAL, other=other, column=0),
            at_most=1.0 - CLEAR,
            given=True,
            note=FROM_TABLE,
        )
        for other in (BASELINE, EXPERIMENTAL)
    ),
    *(
        Statement(
            id=f"peak-explains-{model.removeprefix('delrin_')}-{name.split()[-1]}",
            section="IV-C.2, V",
            figure="table1",
            claim=f"The higher {name} of {NAMES[model]} is due to its lower peak torque.",
            measured=f"average {name} if this material had the baseline's peak torque, relative to as it is",
            measure=partial(measures.equal_peak_ratio, model=model, column=column),
            at_most=1.0 - CLEAR,
            note="The paper calls it likely; here the material's torques are scaled up and the runs repeated.",
            reason="Raising its peak torque leaves the acceleration as it is; T_s/T_k makes the difference.",
        )
        for model in (EXPERIMENTAL, THEORETICAL)
        for column, (name, _) in enumerate(COLUMNS)
        if column > 0
    ),
)
"""In the order of the paper."""
