"""From a device to a verdict: what it can render, and how well laws tuned for it do."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.tools.device.report import DeviceReport, examine_device

__all__ = ["DeviceReport", "examine_device"]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__, submod_attrs={"report": ["DeviceReport", "examine_device"]}
)
