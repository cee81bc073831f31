"""Parameters of a real machine from a log of it, with the compiled simulator as the model."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.tools.identification.experiment import EXPERIMENT, RECORDER, Experiment, Recorder, record_log
    from pter_gym.tools.identification.identifying import Finding, Identification, identify
    from pter_gym.tools.identification.log import Log, read_log, write_log
    from pter_gym.tools.identification.parameters import Quantity, quantities
    from pter_gym.tools.identification.preset import preset_of
    from pter_gym.tools.identification.report import report

__all__ = [
    "EXPERIMENT",
    "RECORDER",
    "Experiment",
    "Finding",
    "Identification",
    "Log",
    "Quantity",
    "Recorder",
    "identify",
    "preset_of",
    "quantities",
    "read_log",
    "record_log",
    "report",
    "write_log",
]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "experiment": ["EXPERIMENT", "RECORDER", "Experiment", "Recorder", "record_log"],
        "identifying": ["Finding", "Identification", "identify"],
        "log": ["Log", "read_log", "write_log"],
        "parameters": ["Quantity", "quantities"],
        "preset": ["preset_of"],
        "report": ["report"],
    },
)
