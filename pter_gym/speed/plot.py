"""The cost of a control step against the number of worlds."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from pter_gym.plots.style import REFERENCE, WIDTH, label, styled
from pter_gym.speed import Speed
from pter_gym.speed.ours import Throughput
from pter_gym.speed.peers import Kind

MARKERS = ("s", "D", "^", "v")


@styled
def cost_figure(speed: Speed) -> Figure:
    """Return the time of a whole control step of one world over the number of worlds, ours and the peers'."""
    figure = Figure(figsize=(WIDTH, 4.6))
    axes = figure.add_subplot()
    cores = speed.machine["cores"]
    draw_rows(axes, speed.one_thread.rows, "ours, one thread")
    draw_rows(axes, speed.all_threads.rows, f"ours, {cores} threads")
    if speed.cuda is not None:
        draw_rows(axes, speed.cuda.rows, f"ours, {speed.cuda.device}")
    rows = [row for row in speed.peers if row.kind == Kind.ENV_STEPS]
    for marker, row in zip(MARKERS, rows, strict=False):
        name = f"{row.name} {row.version}" if row.package not in row.name.lower() else f"{row.name} ({row.version})"
        axes.plot(row.worlds, 1e9 / row.steps_per_second, linestyle="none", marker=marker, label=name, color=REFERENCE)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(plain_number))
    label(axes, "worlds [1]", "time per env-step of one world [ns]")
    axes.set_title(f"Cost of an env-step: {speed.substeps_per_step} substeps, observation, reward, reset")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def draw_rows(axes: Axes, rows: Sequence[Throughput], name: str) -> None:
    """Draw the cost over the number of worlds."""
    axes.plot([row.worlds for row in rows], [row.nanoseconds_per_step for row in rows], marker="o", label=name)


def plain_number(value: float, _: int | None) -> str:
    """Return a tick's label without exponents."""
    return f"{value:,.10g}"
