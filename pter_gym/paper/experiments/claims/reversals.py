"""Claims about Fig. 9: the torque of a clutch where the direction of motion changes."""

from functools import partial

from pter_gym.paper.experiments import measures
from pter_gym.paper.experiments.claims.statement import NAMES, Statement
from pter_gym.paper.experiments.measures import BASELINE, EXPERIMENTAL, THEORETICAL

REVERSALS: tuple[Statement, ...] = (
    *(
        Statement(
            id=f"jump-{model.removeprefix('delrin_')}",
            section="IV-C.2, Fig. 9",
            figure="fig9",
            claim=f"With {NAMES[model]} the torque jumps where the direction of motion changes.",
            measured="largest torque within 50 ms of zero slip, relative to the dynamic one, minus 1",
            measure=partial(measures.jump, model=model),
            at_least=0.10,
            given=True,
            note="T_s/T_k ≥ 1.12 is put into the model because of this figure.",
        )
        for model in (BASELINE, EXPERIMENTAL)
    ),
    Statement(
        id="jump-similar",
        section="IV-C.2, Fig. 9",
        figure="fig9",
        claim="The two jumps are similar.",
        measured="jump of experimental Delrin relative to that of the present clutches",
        measure=measures.jump_ratio,
        at_least=0.5,
        at_most=2.0,
        given=True,
        note="T_s/T_k of both materials is put into the model.",
        reason="The fit to Table I put T_s/T_k at 1.43 for experimental Delrin and at 1.12 for the present clutches.",
    ),
    Statement(
        id="jump-theoretical",
        section="IV-C.2, Fig. 9",
        figure="fig9",
        claim="With theoretical Delrin there is no such jump.",
        measured="largest torque within 50 ms of zero slip, relative to the dynamic one, minus 1",
        measure=partial(measures.jump, model=THEORETICAL),
        at_most=0.01,
        note="For T_k > T_s the model is in the limit of a vanishing stick band, in which nothing exceeds T_k.",
    ),
    Statement(
        id="lower-jerk",
        section="IV-C.2",
        figure="fig9",
        claim="A Delrin clutch as published would give a lower jerk, a smoother feel.",
        measured="drop of the torque as slip resumes, relative to the present clutches",
        measure=measures.drop_ratio,
        at_most=0.1,
        note="Follows from the missing jump.",
    ),
)
"""In the order of the paper."""
