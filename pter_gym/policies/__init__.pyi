from ._files import (
    read_policy as read_policy,
    shipped_policies as shipped_policies,
    write_policy as write_policy,
)
from ._interface import Input as Input, Interface as Interface
from ._trained import TrainedController as TrainedController
