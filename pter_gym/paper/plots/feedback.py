"""Section IV-C.3, torque feedback: Figs. 10 and 11."""

from matplotlib.figure import Figure

from pter_gym.benchmark.measures import column
from pter_gym.paper.experiments.feedback import BEST_GAIN, GainSweep, LineFollowing
from pter_gym.paper.experiments.measures import PLATEAU_FROM
from pter_gym.paper.plots.marks import FAINT, MILLIMETRE, mark_line
from pter_gym.plots.legends import legend_of
from pter_gym.plots.style import (
    COLOURS,
    REFERENCE,
    WIDTH,
    inches_above,
    inches_right,
    label,
    scaled,
    styled,
)
from pter_gym.units import to_inch_pounds


@styled
def error_over_gain(result: GainSweep) -> Figure:
    """Return Fig. 10: position error over the gain of the torque feedback, and how much the clutches saturate."""
    figure = Figure(figsize=(WIDTH, 4.4))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    above.plot(
        result.gain, result.position_error / MILLIMETRE, marker="o", markersize=5.0, linewidth=1.2, clip_on=False
    )
    below.plot(
        result.gain,
        100.0 * result.saturated,
        color=COLOURS[1],
        linestyle="-",
        marker="s",
        markersize=4.5,
        linewidth=1.2,
        clip_on=False,
    )
    for axes in (above, below):
        axes.axvline(BEST_GAIN, color=FAINT, linestyle=":", linewidth=1.0)
        axes.axvspan(PLATEAU_FROM, result.gain[-1], color=REFERENCE, alpha=0.06, linewidth=0.0)
        axes.set_xlim(result.gain[0], result.gain[-1])
        axes.set_ylim(bottom=0.0)
    below.set_ylim(top=max(105.0 * float(result.saturated.max()), 5.0))
    mark_line(above, f"the paper's best gain, {BEST_GAIN:g}", BEST_GAIN, top=False)
    mark_line(above, "the paper: about constant here", PLATEAU_FROM, top=True)
    label(above, "", "average position error [mm]")
    label(below, "gain $K_p$ [V/(in·lbf)]", "saturated\ncommands [%]")
    inches_right(above, "average position error", MILLIMETRE)
    above.secondary_xaxis("top", functions=scaled(to_inch_pounds(1.0))).set_xlabel("gain $K_p$ [V/(N·m)]")
    return figure


@styled
def followed_lines(result: LineFollowing) -> Figure:
    """Return Fig. 11: how far from the line the tip was along it, without and with torque feedback."""
    figure = Figure(figsize=(WIDTH, 2.8))
    axes = figure.add_subplot()
    axes.axhline(0.0, color=REFERENCE, linestyle="-", linewidth=4.0, alpha=0.3, label="desired line")
    for run, name in (
        (result.without, "without torque feedback"),
        (result.with_feedback, f"with torque feedback, $K_p$ = {result.gain:g} V/(in·lbf)"),
    ):
        average = f"{result.setup.position_error(run.score) / MILLIMETRE:.1f} mm on average"
        arc_length, error = column(run.telemetry, "arc_length"), column(run.telemetry, "normal_error")
        axes.plot(arc_length, error / MILLIMETRE, label=f"{name}: {average}")
    axes.set_xlim(0.0, result.setup.task.path.length)
    label(axes, "distance along the line [m]", "distance from the line [mm]")
    inches_above(axes, "distance along the line")
    inches_right(axes, "distance from the line", MILLIMETRE)
    legend_of(figure, axes, f"line-following test, τ = {result.without.time_constant:g} s")
    return figure
