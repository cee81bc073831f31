"""The cost of a control step against the number of worlds."""

from itertools import count

from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from pter_gym.tools.figures import WIDTH, label, legend_of, numbered, styled
from pter_gym.tools.speed import Speed
from pter_gym.tools.speed.peers import Kind


@styled
def cost_figure(speed: Speed) -> Figure:
    """Return the time of a whole control step of one world over the number of worlds, ours and the peers'."""
    figure = Figure(figsize=(WIDTH, 3.6))
    axes = figure.add_subplot()
    ours = {
        "ours, one thread": speed.one_thread.rows,
        f"ours, {speed.machine['cores']} threads": speed.all_threads.rows,
    }
    if speed.cuda is not None:
        ours[f"ours, {speed.cuda.device}"] = speed.cuda.rows
    for look, (name, rows) in zip(map(numbered, range(3)), ours.items(), strict=False):
        worlds, cost = [row.worlds for row in rows], [row.nanoseconds_per_step for row in rows]
        axes.plot(worlds, cost, color=look.colour, linestyle=look.dashes, marker=look.marker, label=name)
    for look, row in zip(
        map(numbered, count(3)), (row for row in speed.peers if row.kind == Kind.ENV_STEPS), strict=False
    ):
        name = f"{row.name} {row.version}" if row.package not in row.name.lower() else f"{row.name} ({row.version})"
        axes.plot(
            row.worlds, 1e9 / row.steps_per_second, linestyle="none", marker=look.marker, label=name, color=look.colour
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:,.10g}"))
    label(axes, "worlds [1]", "time per env-step of one world [ns]")
    legend_of(figure, axes, f"an env-step: {speed.substeps_per_step} substeps, observation, reward, reset")
    return figure
