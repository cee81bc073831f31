"""Write a control law: a Python function for one world, compiled into the simulator and ranked beside another law."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pter_gym.benchmark import find_policy, print_boards, run_scenario
from pter_gym.controllers import PerClutch, Policy, device
from pter_gym.tasks.path_following import OBS


@device
def brake_by_distance(obs, scales, gains, memory):
    """Brake both axes more, the further the tip is from the path."""
    distance = abs(obs[OBS.normal_error] * scales[OBS.normal_error])  # m
    volts = gains[0] + gains[1] * distance
    return PerClutch(volts, volts, 0.0, 0.0)


@dataclass(frozen=True)
class Cautious:
    rest: float = 3.0  # V
    per_metre: float = 80.0  # V/m

    def bind(self, machine: Any, layout: Any) -> Policy:
        """Return the policy for a machine, and for observations with this layout."""
        return Policy(np.array([self.rest, self.per_metre]), layout, law=brake_by_distance)


policies = {"cautious": Cautious(), "torque-feedback": find_policy("torque-feedback")}
print_boards(run_scenario("standard", policies, ["medium"], episodes=20))
