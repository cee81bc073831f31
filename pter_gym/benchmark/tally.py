"""Sums over episodes for the scores of path and pace, row by row, without storing telemetry.

Each sum is in the order of time, so an episode has the same bits alone and among others.
"""

import math
from functools import cache
from typing import Any, NamedTuple

from pter_gym._compiled.compiler import compile_kernel
from pter_gym._compiled.records import Records, lerp, load, rows, store
from pter_gym.tasks.path_following import COLUMN


class Sums(NamedTuple):
    """Sums up to an instant: time [s], ∫|e|dt [m·s], ∫|e|ds [m²] and ∫e²ds [m³].

    e is the normal error. Over the arc length, each increment of its running maximum counts with
    the largest |e| since the previous one.
    """

    time: float
    in_time: float
    on_path: float
    squared: float


class Progress(NamedTuple):
    """How far an episode is: its sums, the running maximum of the arc length, and |e|.

    ``since`` is the largest |e| since the tip last advanced, ``largest`` that of all, both in m,
    and ``success`` is 1 once the end of the path is reached.
    """

    sums: Sums
    furthest: float
    since: float
    largest: float
    success: float


SUMS, PROGRESS = rows(Sums), rows(Progress)


def _build_tally(digest: str) -> Any:
    def tally(telemetry: Any, marks: Records, progress: Any, passed: Any) -> None:
        _ = digest
        worlds = telemetry.shape[1]
        for t in range(telemetry.shape[0]):
            for i in range(worlds):
                time = telemetry[t, i, COLUMN.time]
                if math.isnan(time):
                    continue
                then = load(progress, PROGRESS, i)
                begins = math.isnan(then.sums.time)
                low = Sums(
                    time if begins else then.sums.time,
                    then.sums.in_time,
                    then.sums.on_path,
                    then.sums.squared,
                )
                error = abs(telemetry[t, i, COLUMN.normal_error])
                s = telemetry[t, i, COLUMN.arc_length]
                since = error if error > then.since else then.since
                furthest = s if s > then.furthest else then.furthest
                advance = furthest - then.furthest
                high = Sums(
                    time,
                    low.in_time + (time - low.time) * error,
                    low.on_path + since * advance,
                    low.squared + since * since * advance,
                )
                for k in range(marks.shape[0]):
                    mark = marks[k, i]
                    if then.furthest < mark <= furthest:
                        part = (mark - then.furthest) / advance
                        store(passed, SUMS, k * worlds + i, lerp(low, high, part))
                    elif begins and mark <= 0.0:
                        store(passed, SUMS, k * worlds + i, low)
                now = Progress(
                    high,
                    furthest,
                    0.0 if advance > 0.0 else since,
                    error if error > then.largest else then.largest,
                    1.0 if telemetry[t, i, COLUMN.is_success] == 1.0 else then.success,
                )
                store(progress, PROGRESS, i, now)

    return tally


@cache
def tally_kernel() -> Any:
    """Return ``tally(telemetry, marks, progress, passed)``, which goes on with some rows.

    ``telemetry`` is (T, N, columns), NaN after the end of an episode; ``marks`` are arc lengths,
    (K, N) [m]; ``progress``, (width, N), holds a ``Progress`` of each episode, at first with NaN as
    time; ``passed``, (width, K·N), the ``Sums`` when the running maximum of the arc length passed
    a mark, NaN for those never passed.
    """
    return compile_kernel(_build_tally)
