"""Report of a finished run: scores, a learning curve and a film, compared with tuned laws."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from pter_agents.draws import PaceScores, validate, validation_episodes
from pter_agents.settings import TrainingArguments
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.boards import is_ranked
from pter_gym.benchmark.rollout import record_episodes
from pter_gym.controllers import Controller
from pter_gym.scenarios import PACES
from pter_gym.tools.figures import MILLIMETRE, MUTED, SMALL, WIDTH, looks, styled
from pter_gym.tools.pictures.film import write_film
from pter_gym.tools.pictures.plots import plain_ticks

COMPARED_LAWS = ("single-dof-tuned", "torque-feedback-tuned")
"""Tuned laws to compare with: the best one, and the better of the paper's two."""


def law_scores(arguments: TrainingArguments) -> dict[str, PaceScores]:
    """Return the scores of ``LAWS`` on the validation episodes of a run."""
    episodes = validation_episodes(arguments)
    return {name: validate(find_policy(name, arguments.gains), episodes) for name in COMPARED_LAWS}


def table(rows: Mapping[str, PaceScores]) -> str:
    """Return scores as text, a line for each policy."""
    width = max(map(len, rows))
    return "\n".join(f"{name:{width}}  {in_words(scores)}" for name, scores in rows.items())


def in_words(scores: PaceScores) -> str:
    """Return path errors and arrivals at each pace."""
    return "; ".join(
        f"{pace} {values['path_error_m'] / MILLIMETRE:5.1f} mm, {values['completed']:4.0%} arrive"
        for pace, values in scores.items()
    )


@styled
def learning_curve(history: Mapping[int, PaceScores], laws: Mapping[str, PaceScores]) -> Figure:
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
    # a white outline, so that labels can be read on lines
    outline = {"path_effects": [withStroke(linewidth=2.0, foreground="white")], "zorder": 4}
    label = {"xytext": (0.0, 2.0), "textcoords": "offset points", "fontsize": SMALL, **outline}
    for (above, below), pace, look in zip(panels.T, paces, looks(paces).values(), strict=True):
        for name, scores in laws.items():
            error = scores[pace]["path_error_m"] / MILLIMETRE
            above.axhline(error, color=MUTED, linewidth=0.8, linestyle="--")
            place = above.get_yaxis_transform()
            above.annotate(
                f"{name} {error:.1f}", (0.02, error), xycoords=place, color=MUTED, **label
            )
        at_pace = [scores[pace] for scores in history.values()]
        errors = [each["path_error_m"] / MILLIMETRE for each in at_pace]
        faces = [look.colour if is_ranked(each) else "white" for each in at_pace]
        above.plot(million, errors, color=look.colour)
        above.scatter(million, errors, 14.0, faces, edgecolor=look.colour, zorder=3)
        end = million[-1], errors[-1]
        above.annotate(f"{errors[-1]:.1f} mm", end, ha="right", color=look.colour, **label)
        arrivals = [100.0 * each["completed"] for each in at_pace]
        below.plot(million, arrivals, color=look.colour, marker=".")
        title = f"{pace}, {PACES[pace]:g} m/s"
        above.set(title=title, yscale="log", xlim=(0.0, 1.04 * million[-1]))
        below.set(ylim=(-5.0, 105.0))
    plain_ticks(panels[0, 0], "y")
    panels[0, 0].set_ylabel("path error [mm]")
    panels[1, 0].set_ylabel("arrive [%]")
    figure.supxlabel(
        "steps [million]; hollow: not ranked; dashed: tuned laws on the same episodes",
        fontsize=SMALL,
    )
    return figure


def film(policy: Controller, arguments: TrainingArguments, path: Path) -> Path:
    """Film a policy and the better of the paper's laws on one validation draw."""
    pace = "medium" if "medium" in arguments.paces else arguments.paces[0]
    episode = validation_episodes(arguments)[pace][:1]
    shown = {
        arguments.algorithm: policy,
        COMPARED_LAWS[-1]: find_policy(COMPARED_LAWS[-1], arguments.gains),
    }
    telemetry = {
        name: record_episodes(law, episode, sensors="force").telemetry[:, 0]
        for name, law in shown.items()
    }
    return write_film(episode.machines[0], episode.tasks[0], telemetry, path)
