from .report import DeviceReport as DeviceReport, examine_device as examine_device
