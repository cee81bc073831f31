"""Parameters of a real machine from a log of it, with the compiled simulator as the model."""

from typing import TYPE_CHECKING

from pter_gym._internal.lazy import lazy_names

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

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "pter_gym.tools.identification.experiment": (
            "EXPERIMENT",
            "RECORDER",
            "Experiment",
            "Recorder",
            "record_log",
        ),
        "pter_gym.tools.identification.identifying": (
            "Finding",
            "Identification",
            "identify",
        ),
        "pter_gym.tools.identification.log": (
            "Log",
            "read_log",
            "write_log",
        ),
        "pter_gym.tools.identification.parameters": (
            "Quantity",
            "quantities",
        ),
        "pter_gym.tools.identification.preset": ("preset_of",),
        "pter_gym.tools.identification.report": ("report",),
    },
)
