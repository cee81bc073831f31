"""Report of a finished run: scores, a learning curve and a film, compared with tuned laws."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from pter_agents.draws import draws_for
from pter_agents.settings import TrainingArguments
from pter_agents.training import Scores, progress_of
from pter_agents.validation import SEED, Validation
from pter_agents.worlds import find_base
from pter_gym.benchmark.rollout import record_episode
from pter_gym.controllers import Controller
from pter_gym.scenarios import PACES
from pter_gym.tools.figures import MILLIMETRE, MUTED, SMALL, WIDTH, looks, styled
from pter_gym.tools.pictures.film import write_film
from pter_gym.tools.pictures.plots import plain_ticks

LAWS = ("single-dof-tuned", "torque-feedback-tuned")
"""Tuned laws to compare with: the best one, and the better of the paper's two."""


def law_scores(arguments: TrainingArguments) -> dict[str, Scores]:
    """Return the scores of ``LAWS`` on the validation episodes of a run."""
    validation = Validation(
        arguments.scenario, arguments.paces, arguments.validation_episodes, arguments.machine
    )
    return {name: validation.scores(_law(name, arguments)) for name in LAWS}


def _law(name: str, arguments: TrainingArguments) -> Controller:
    law = find_base(name, arguments.scenario)
    assert law is not None
    return law


def table(rows: Mapping[str, Scores]) -> str:
    """Return scores as text, a line for each policy."""
    width = max(map(len, rows))
    return "\n".join(f"{name:{width}}  {in_words(scores)}" for name, scores in rows.items())


def in_words(scores: Scores) -> str:
    """Return path errors and arrivals at each pace."""
    return "; ".join(
        f"{pace} {values['path_error_m'] / MILLIMETRE:5.1f} mm, {values['completed']:4.0%} arrive"
        for pace, values in scores.items()
    )


@styled
def learning_curve(history: Mapping[int, Scores], laws: Mapping[str, Scores]) -> Figure:
    """Return path errors and arrivals over steps, a column for each pace.

    Parameters
    ----------
    history
        Validation scores by the steps before each; at least one.
    laws
        Scores of laws on the same episodes.
    """
    paces = list(next(iter(history.values())))
    figure = Figure(figsize=(max(len(paces) / 3.0, 0.6) * WIDTH, 3.6))
    panels = figure.subplots(
        2, len(paces), sharex=True, sharey="row", squeeze=False, height_ratios=(3, 1)
    )
    million = np.array(list(history)) / 1e6
    for (above, below), pace, look in zip(panels.T, paces, looks(paces).values(), strict=True):
        for name, scores in laws.items():
            error = scores[pace]["path_error_m"] / MILLIMETRE
            above.axhline(error, color=MUTED, linewidth=0.8, linestyle="--")
            _write(
                above,
                f"{name} {error:.1f}",
                (0.02, error),
                above.get_yaxis_transform(),
                ha="left",
                color=MUTED,
            )
        at_pace = [scores[pace] for scores in history.values()]
        errors = [each["path_error_m"] / MILLIMETRE for each in at_pace]
        faces = [look.colour if progress_of(each)["ranked"] else "white" for each in at_pace]
        above.plot(million, errors, color=look.colour)
        above.scatter(million, errors, 14.0, faces, edgecolor=look.colour, zorder=3)
        _write(
            above,
            f"{errors[-1]:.1f} mm",
            (million[-1], errors[-1]),
            "data",
            ha="right",
            color=look.colour,
        )
        below.plot(
            million, [100.0 * each["completed"] for each in at_pace], color=look.colour, marker="."
        )
        above.set(
            title=f"{pace}, {PACES[pace]:g} m/s", yscale="log", xlim=(0.0, 1.04 * million[-1])
        )
        below.set(ylim=(-5.0, 105.0))
    plain_ticks(panels[0, 0], "y")
    panels[0, 0].set_ylabel("path error [mm]")
    panels[1, 0].set_ylabel("arrive [%]")
    figure.supxlabel(
        "steps [million]; hollow: not ranked; dashed: tuned laws on the same episodes",
        fontsize=SMALL,
    )
    return figure


def _write(axes: Axes, text: str, at: tuple[float, float], coordinates: Any, **style: Any) -> None:
    """Write a label above a point, with a white outline so that it can be read on lines."""
    outline = [withStroke(linewidth=2.0, foreground="white")]
    options: Any = {
        "fontsize": SMALL,
        "va": "bottom",
        "path_effects": outline,
        "zorder": 4,
        **style,
    }
    axes.annotate(text, at, (0.0, 2.0), coordinates, "offset points", **options)


def film(policy: Controller, arguments: TrainingArguments, path: Path) -> Path:
    """Film a policy and the better of the paper's laws on one validation draw."""
    pace = "medium" if "medium" in arguments.paces else arguments.paces[0]
    machine, task = draws_for(arguments.scenario, pace, arguments.machine).pairs(1, SEED)[0]
    shown = {arguments.algorithm: policy, LAWS[-1]: _law(LAWS[-1], arguments)}
    episodes = {
        name: record_episode(law, machine, task, 0, nominal=arguments.nominal).telemetry
        for name, law in shown.items()
    }
    return write_film(machine, task, episodes, path)
