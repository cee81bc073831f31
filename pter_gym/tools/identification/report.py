"""The report: one HTML file that needs nothing else."""

import base64
from collections import Counter
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader

from pter_gym._version import __version__
from pter_gym.tools.figures import INK, MUTED, png
from pter_gym.tools.identification import pictures
from pter_gym.tools.identification.identifying import Identification


def report(found: Identification) -> str:
    """Return the report of an identification as HTML."""
    windows = found.fit.windows
    drawn = {
        "intervals": pictures.intervals(found),
        "curves": pictures.curves(found),
        "residuals": pictures.residuals(found),
        "recording": pictures.recording(found),
    }
    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    pages.filters["number"] = number
    return pages.get_template("report.html").render(
        version=__version__,
        ink=INK,
        muted=MUTED,
        found=found,
        log=found.log,
        counts=Counter(finding.status for finding in found.findings),
        unknown=[finding for finding in found.findings if finding.status != "identified"],
        windows=windows,
        used=int(windows.used.sum()),
        rms=(1e3 * np.sqrt(np.nanmean(found.residuals**2, axis=(0, 1)))).tolist(),
        pictures={name: base64.b64encode(png(figure)).decode() for name, figure in drawn.items()},
    )


def number(value: float) -> str:
    """Return a number with four digits and a typographic minus sign."""
    return f"{value:.4g}".replace("-", "−")
