"""The report: one HTML file that needs nothing else."""

import base64
from html import escape

import numpy as np
from matplotlib.figure import Figure

from pter_gym._version import __version__
from pter_gym.identification import pictures
from pter_gym.identification.identifying import Finding, Identification
from pter_gym.plots.style import INK, MUTED, png

STYLE = f"""
body {{ font: 16px/1.5 system-ui, sans-serif; color: {INK}; margin: 2rem auto; max-width: 72rem; padding: 0 1rem; }}
h1, h2 {{ line-height: 1.2; }} h2 {{ margin-top: 2.2rem; }}
.table {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; }}
th, td {{ border-bottom: 1px solid #e3e5e9; padding: 0.25rem 0.6rem; text-align: left; vertical-align: top; }}
th {{ font-weight: 600; }} td:first-child, td:last-child {{ white-space: nowrap; }}
.number {{ text-align: right; white-space: nowrap; }}
.kept {{ color: {MUTED}; }} .identified::before {{ content: "● "; }} .uncertain::before {{ content: "◐ "; }}
.kept.state::before {{ content: "○ "; }}
img {{ max-width: 100%; height: auto; }} figure {{ margin: 1rem 0; }} figcaption {{ color: {MUTED}; }}
"""

HEAD = ("Number", "Meaning", "Unit", "Value", "95 % interval", "±", "Start", "State")


def report(found: Identification) -> str:
    """Return the report of an identification as HTML."""
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(found.log.name)}: identified machine</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{STYLE}</style></head><body>",
        "<h1>An identified machine</h1>",
        f"<p>{summary(found)}</p>",
        "<h2>Numbers</h2>",
        _table(found),
        f"<p>{READING}</p>",
        _figure(pictures.intervals(found), "Intervals of what is identified, over the scale of each number."),
        "<h2>What the log does not show</h2>",
        _unknown(found),
        "<h2>Clutches</h2>",
        _figure(
            pictures.curves(found), "Torque over voltage. Points: the mean of the clutches with its 95 % interval."
        ),
        _experience(found),
        "<h2>Residuals</h2>",
        f"<p>{_residuals(found)}</p>",
        _figure(
            pictures.residuals(found), "What the identified machine does not predict, in windows begun at the log."
        ),
        "<h2>The log</h2>",
        _figure(pictures.recording(found), "What was recorded."),
        f"<p class='kept'>pter_gym {escape(__version__)}</p>",
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


READING = (
    "Identified: the 95 % interval is within ±5 % of the number. Uncertain: it is wider; the number is used. Kept: the "
    "log does not show it, and the number of the start is kept. The coupling is judged against √(M11·M22), the delay "
    "against itself or a control step of 10 ms, whichever is longer. Intervals hold if the "
    "machine is of the simulator's kind; they know nothing of "
    "errors of the sensors' scale, of wrong link lengths, or of friction that depends on speed or temperature."
)


def summary(found: Identification) -> str:
    """Return in words what was found."""
    log = found.log
    counts = {state: sum(f.status == state for f in found.findings) for state in ("identified", "uncertain", "kept")}
    rows = f"{len(log.theta)} rows in {log.duration:.1f} s"
    forces = "with forces" if log.force is not None else "without forces"
    text = (
        f"From {escape(log.name)}, {rows}, {forces}: {counts['identified']} numbers identified within ±5 %, "
        f"{counts['uncertain']} uncertain, {counts['kept']} kept from the start."
    )
    if log.force is None:
        text += " Without forces, inertias and torques are known only relative to the inertia of link A."
    return text


def _table(found: Identification) -> str:
    head = "".join(
        f"<th{NUMBER if name in ('Value', '95 % interval', '±', 'Start') else ''}>{name}</th>" for name in HEAD
    )
    body = "\n".join(map(_row, found.findings))
    return f"<div class='table'><table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>"


NUMBER = " class='number'"


def _row(finding: Finding) -> str:
    q = finding.quantity
    kept = finding.status == "kept"
    interval = "" if kept else f"{number(finding.low)} to {number(finding.high)}"
    share = "" if kept else f"{100.0 * finding.share:.1f} %" + (f" {q.judged}" if q.judged else "")
    state = finding.status + (", relative" if finding.relative else "")
    return (
        f"<tr{' class=kept' if kept else ''}><td><code>{q.name}</code></td><td>{escape(q.meaning)}</td>"
        f"<td>{q.unit}</td>"
        f"<td{NUMBER}>{number(q.value)}</td><td{NUMBER}>{interval}</td><td{NUMBER}>{share}</td>"
        f"<td{NUMBER}>{number(finding.before)}</td><td class='state {finding.status}'>{state}</td></tr>"
    )


def number(value: float) -> str:
    """Return a number with four digits and a typographic minus sign."""
    return f"{value:.4g}".replace("-", "−")


def _unknown(found: Identification) -> str:
    told = [finding for finding in found.findings if finding.status != "identified"]
    if not told:
        return "<p>Nothing: all numbers are identified.</p>"
    items = [
        f"<li><code>{f.quantity.name}</code>: {escape(f.reason or f'±{100.0 * f.share:.0f} % only')}. "
        f"What helps: {escape(f.remedy)}.</li>"
        for f in told
    ]
    return f"<ul>\n{''.join(items)}\n</ul>"


def _experience(found: Identification) -> str:
    rows = "".join(
        f"<tr><td>{x + 1}</td><td{NUMBER}>{found.slipped[x]:.1f}</td><td{NUMBER}>{found.breakaways[x]}</td></tr>"
        for x in range(4)
    )
    head = f"<th>Clutch</th><th{NUMBER}>slipped while on [s]</th><th{NUMBER}>broke away</th>"
    return f"<div class='table'><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"


def _residuals(found: Identification) -> str:
    windows = found.fit.windows
    off = found.residuals
    rms = 1e3 * np.sqrt(np.nanmean(off**2, axis=(0, 1)))
    return (
        f"{int(windows.used.sum())} of {len(windows.first)} windows of {windows.length * found.log.interval:.3g} s are "
        f"used. What is not predicted has a root mean square of {rms[0]:.3g} mrad for θA and {rms[1]:.3g} mrad for θB; "
        f"the angles have {1e3 * windows.noise:.2g} mrad of noise. Residuals far above the noise show what "
        f"the model does not have."
    )


def _figure(figure: Figure, caption: str) -> str:
    data = base64.b64encode(png(figure)).decode()
    text = escape(caption)
    return f"<figure><img alt='{text}' src='data:image/png;base64,{data}'><figcaption>{text}</figcaption></figure>"
