"""Episodes as tables in a CSV file or a NumPy archive, with the names and units of the telemetry as columns."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.files import write_bytes_atomic
from pter_gym.errors import ParameterError
from pter_gym.tasks.path_following import TELEMETRY

Array = NDArray[np.float64]

ENDINGS = (".csv", ".npz")


def write_trajectories(episodes: Mapping[str, Array], path: Path) -> None:
    """Write episodes one below another to a file, atomically; the same episodes give the same bytes.

    Parameters
    ----------
    episodes
        By the name of the policy: telemetry from the reset on, float64 (T + 1, len(TELEMETRY)).
    path
        ``.csv`` has headings such as ``policy`` and ``time [s]``, and all digits of each number; ``.npz`` an array
        for each column under its name, and ``names`` and ``units`` of the columns.

    Raises
    ------
    ParameterError
        If the file has another extension.
    """
    check_table(path)
    write_bytes_atomic(path, _as_csv(episodes) if path.suffix.lower() == ".csv" else _as_npz(episodes))


def check_table(path: Path) -> None:
    """Raise a ParameterError unless a table can be written to a file with this extension."""
    if path.suffix.lower() not in ENDINGS:
        raise ParameterError(f"csv must end in {', '.join(ENDINGS)}, got {str(path)!r}")


def _as_csv(episodes: Mapping[str, Array]) -> bytes:
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["policy", *(f.name if f.unit == "1" else f"{f.name} [{f.unit}]" for f in TELEMETRY.fields)])
    for name, telemetry in episodes.items():
        rows.writerows([name, *row] for row in telemetry.tolist())
    return text.getvalue().encode()


def _as_npz(episodes: Mapping[str, Array]) -> bytes:
    content = io.BytesIO()
    columns = dict(zip(TELEMETRY.names, np.concatenate(list(episodes.values())).T, strict=True))
    policies = np.repeat(list(episodes), [len(telemetry) for telemetry in episodes.values()])
    units = [field.unit for field in TELEMETRY.fields]
    np.savez_compressed(content, policy=policies, names=TELEMETRY.names, units=units, **columns)
    return content.getvalue()
