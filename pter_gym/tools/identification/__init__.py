"""Parameters of a real machine from a log of it, with the compiled simulator as the model.

The log is cut into windows, a machine is fitted to them, and a verdict says whether the model
explains them.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.tools.identification.identifying import Finding, Identification, identify
    from pter_gym.tools.identification.log import Log, join_logs, read_log, write_log
    from pter_gym.tools.identification.parameters import Quantity, quantities

__all__ = [
    "Finding",
    "Identification",
    "Log",
    "Quantity",
    "identify",
    "join_logs",
    "quantities",
    "read_log",
    "write_log",
]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "identifying": ["Finding", "Identification", "identify"],
        "log": ["Log", "join_logs", "read_log", "write_log"],
        "parameters": ["Quantity", "quantities"],
    },
)
