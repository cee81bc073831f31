"""From the description of a device to a verdict: what it can render, a law tuned for it, and how well that does."""

from pter_gym.tools.device.report import DeviceReport, examine_device

__all__ = ["DeviceReport", "examine_device"]
