from .findings import Finding as Finding
from .hand import MeasuredHand as MeasuredHand, identify_hand as identify_hand
from .identifying import Identification as Identification, identify as identify
from .log import Log as Log, join_logs as join_logs, read_log as read_log, write_log as write_log
from .parameters import Quantity as Quantity, quantities as quantities
from .pulses import MIDDLE as MIDDLE, forces_around as forces_around, tip_positions as tip_positions
from .rehearsal import rehearse as rehearse
