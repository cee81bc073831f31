"""Episodes as tables in a CSV file, with the names and units of the telemetry as headings."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import write_text_atomic
from pter_gym.errors import ParameterError
from pter_gym.tasks.path_following import TELEMETRY


def write_trajectories(episodes: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Write episodes one below another to a CSV file, atomically, with all digits of each number.

    ``episodes`` holds telemetry from the reset on, float64 (T + 1, len(TELEMETRY)), by the name of
    the policy. Headings are such as ``policy`` and ``time [s]``. Raises a ParameterError if the
    path does not end in .csv.
    """
    check_table(path)
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(
        ["policy", *(f.name if f.unit == "1" else f"{f.name} [{f.unit}]" for f in TELEMETRY.fields)]
    )
    for name, telemetry in episodes.items():
        rows.writerows([name, *row] for row in telemetry.tolist())
    write_text_atomic(path, text.getvalue())


def check_table(path: Path) -> None:
    """Raise a ParameterError unless a table can be written to a file with this extension."""
    if path.suffix.lower() != ".csv":
        raise ParameterError(f"csv must end in .csv, got {str(path)!r}")
