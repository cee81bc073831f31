"""Claims of section IV-B: torque over voltage of the clutches' materials."""

from functools import partial

from pter_gym.paper.experiments import measures
from pter_gym.paper.experiments.claims.statement import CLEAR, STICTION, Statement
from pter_gym.paper.experiments.measures import BASELINE, EXPERIMENTAL, THEORETICAL

MATERIALS: tuple[Statement, ...] = (
    Statement(
        id="zero-without-voltage",
        section="IV-B.1",
        figure="fig5",
        claim="Without voltage a clutch has no torque.",
        measured="largest torque at 0 V",
        measure=measures.torque_without_voltage,
        unit="N·m",
        at_most=1e-9,
        given=True,
        note="The paper's assumption, put into the model.",
    ),
    Statement(
        id="stiction-baseline",
        section="IV-B.1, Fig. 5",
        figure="fig5",
        claim="The present clutches have a higher breakaway than dynamic torque.",
        measured="smallest ratio of breakaway to dynamic torque",
        measure=partial(measures.breakaway_ratio, model=BASELINE),
        at_least=STICTION,
        given=True,
        note="Put into the model: a smaller ratio would hide the jump of Fig. 9.",
    ),
    Statement(
        id="stiction-experimental",
        section="IV-C.2",
        figure="fig5",
        claim="Delrin as measured sticks and slips like the present clutches.",
        measured="smallest ratio of breakaway to dynamic torque",
        measure=partial(measures.breakaway_ratio, model=EXPERIMENTAL),
        at_least=STICTION,
        given=True,
        note="Put into the model: a smaller ratio would hide the jump of Fig. 9.",
    ),
    Statement(
        id="delrin-dynamic",
        section="IV-B.2",
        figure="fig5",
        claim="Delrin as published has a higher dynamic than static friction (0.35 and 0.20).",
        measured="smallest ratio of dynamic to breakaway torque",
        measure=partial(measures.dynamic_ratio, model=THEORETICAL),
        at_least=1.74,
        at_most=1.76,
        given=True,
        note="The published coefficients, put into the model.",
    ),
    Statement(
        id="lower-peak-experimental",
        section="IV-C.2",
        figure="fig5",
        claim="Experimental Delrin has a lower peak torque than the present clutches.",
        measured="peak torque relative to the present clutches",
        measure=partial(measures.peak_ratio, model=EXPERIMENTAL),
        at_most=1.0 - CLEAR,
        given=True,
        note="The scale of this material is fitted.",
    ),
    Statement(
        id="lower-peak-theoretical",
        section="IV-C.2",
        figure="fig5",
        claim="Theoretical Delrin has a lower peak torque than the present clutches.",
        measured="peak torque relative to the present clutches",
        measure=partial(measures.peak_ratio, model=THEORETICAL),
        at_most=1.0 - CLEAR,
        note="Follows from the published coefficients and T_s/T_k of the present clutches.",
    ),
)
"""In the order of the paper."""
