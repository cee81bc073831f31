"""From a device to a verdict: what it can render, and how well laws tuned for it do."""

from pter_gym.tools.device.report import DeviceReport, examine_device

__all__ = ["DeviceReport", "examine_device"]
