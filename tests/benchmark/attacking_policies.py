"""Policies that attack the process in which they act; each decides as ``honest`` does.

``TAMPERING`` has those that gain in process, where the code of a policy is trusted; ``HARMLESS`` gain nowhere.
"""

import gc
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.tasks.path_following import COLUMN

KEPT: list[Any] = []
OWN = np.zeros((64, 4), np.float32)


def honest(obs: Any) -> Any:
    return np.clip(6.0 + 4.0 * obs[:, :4].astype(np.float64), 0.0, 24.0)


def frames() -> Iterator[dict[str, Any]]:
    """Yield the names of all that call."""
    frame: Any = sys._getframe()
    while frame is not None:
        yield frame.f_locals
        frame = frame.f_back


def clear_errors(rows: list[Any]) -> None:
    """Set the distance from the path to 0 in recorded telemetry."""
    for each in rows:
        each[..., COLUMN.normal_error] = 0.0


def recorded() -> list[list[Any]]:
    """Return what is recorded of the episodes that are run now, if anybody in this process records."""
    return [item._rows for item in gc.get_objects() if type(item).__name__ == "Rollout"]


# --- with a gain in process ---


def reads_frames(obs: Any) -> Any:
    for names in frames():
        if type(names.get("self")).__name__ == "Rollout":
            clear_errors(names["self"]._rows)
    return honest(obs)


def finds_records(obs: Any) -> Any:
    for rows in recorded():
        clear_errors(rows)
    return honest(obs)


def slows_worlds(obs: Any) -> Any:
    """Find the worlds and slow down their arms."""
    for item in gc.get_objects():
        if type(item) is Batch and item.num_worlds == len(obs):
            state = item.get_state()
            state["worlds"][:, [ROW.motion.omega_a, ROW.motion.omega_b]] *= 0.9
            item.set_state(state)
    return honest(obs)


def patches_errors(obs: Any) -> Any:
    from pter_gym.benchmark._recorded import Travel

    Travel.segment_errors = lambda self: 0.0 * self.relative_times
    return honest(obs)


def writes_in_a_thread(obs: Any) -> Any:
    thread = threading.Thread(target=lambda rows: [clear_errors(each) for each in rows], args=(recorded(),))
    thread.start()
    thread.join()
    return honest(obs)


TAMPERING: dict[str, Callable[[Any], Any]] = {
    "reads the frames that call it": reads_frames,
    "finds what is recorded with gc": finds_records,
    "finds the worlds with gc and slows them down": slows_worlds,
    "replaces a function of the package": patches_errors,
    "writes into what is recorded from a thread": writes_in_a_thread,
}


# --- without a gain anywhere ---


def writes_into_observations(obs: Any) -> Any:
    volts = honest(obs)
    obs[:] = 0.0
    return volts


def changes_observations_later(obs: Any) -> Any:
    for kept in KEPT:
        kept[:] = np.nan
    KEPT[:] = [obs]
    return honest(obs)


def closes_observations(obs: Any) -> Any:
    volts = honest(obs)
    obs.setflags(write=False)
    return volts


def returns_its_buffer(obs: Any) -> Any:
    OWN[: len(obs)] = honest(obs)
    return OWN[: len(obs)]


def spoils_its_buffer(obs: Any) -> Any:
    """Return a view of an array that the next call fills with something else before it decides."""
    OWN.fill(np.nan)
    return returns_its_buffer(obs)


HARMLESS: dict[str, Callable[[Any], Any]] = {
    "writes into the observations that it is given": writes_into_observations,
    "keeps its observations and changes them later": changes_observations_later,
    "makes its observations read-only": closes_observations,
    "changes a buffer that it returned": spoils_its_buffer,
}


# --- refused ---


def volts_of(value: Any) -> Callable[[Any], Any]:
    """Return a policy that gives one value for all voltages."""
    return lambda obs: np.full((len(obs), 4), value)


REFUSED: dict[str, Callable[[Any], Any]] = {
    "gives NaN": volts_of(np.nan),
    "gives 1e300 V": volts_of(1e300),
    "gives −1 V": volts_of(-1.0),
    "gives complex voltages": volts_of(1.0 + 2.0j),
    "gives words": volts_of("24"),
    "gives too few voltages": lambda obs: np.zeros((len(obs), 3)),
    "gives voltages for one world more": lambda obs: np.zeros((len(obs) + 1, 4)),
    "gives nothing": lambda obs: None,  # noqa: ARG005
}
