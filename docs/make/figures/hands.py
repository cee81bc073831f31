"""Pictures of hands."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from pter_gym.hands import MeasuredTremor, TremorArm
from pter_gym.plots.style import CLUTCH_COLOURS, MUTED, WIDTH, label, styled

SHOWN = 4.0  # s
STEP = 0.001  # s
LONG = 20.0  # s
FASTEST = 16.0  # Hz


@styled
def force_and_spectrum(hands: Mapping[str, TremorArm], measured: Mapping[str, MeasuredTremor]) -> Figure:
    """Return the force of tremors over time, and its spectrum with the band that was measured."""
    figure = Figure(figsize=(WIDTH, 1.45 * len(hands)))
    panels = figure.subplots(len(hands), 2, sharex="col", squeeze=False)
    times = np.arange(0.0, LONG, STEP)
    window = np.hanning(len(times))
    frequencies = np.fft.rfftfreq(len(times), STEP)
    near = frequencies <= FASTEST
    last = list(hands.values())[-1]
    for (name, hand), (left, right), colour in zip(hands.items(), panels, CLUTCH_COLOURS, strict=False):
        force = hand.tremor(times)
        left.plot(times[times <= SHOWN], force[times <= SHOWN], color=colour, linestyle="-", linewidth=1.0)
        left.set_title(name.removeprefix("tremor-").capitalize())
        label(left, "time [s]" if hand is last else "", "force [N]")
        amplitudes = 2.0 * np.abs(np.fft.rfft(window * force)) / window.sum()
        right.axvspan(*measured[name].band, color=MUTED, alpha=0.15, linewidth=0.0)
        right.plot(frequencies[near], amplitudes[near], color=colour, linestyle="-")
        label(right, "frequency [Hz]" if hand is last else "", "amplitude [N]")
    panels[-1, 0].set_xlim(0.0, SHOWN)
    panels[-1, 1].set_xlim(0.0, FASTEST)
    panels[-1, 1].set_xticks(np.arange(0.0, FASTEST + 1.0, 4.0))
    figure.align_ylabels(panels)
    return figure
