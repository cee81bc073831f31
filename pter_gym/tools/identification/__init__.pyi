from .findings import Finding as Finding
from .identifying import Identification as Identification, identify as identify
from .log import Log as Log, join_logs as join_logs, read_log as read_log, write_log as write_log
from .parameters import Quantity as Quantity, quantities as quantities
