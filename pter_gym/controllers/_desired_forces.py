"""The tip force that an impedance law demands, for whole episodes."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel
from pter_gym._compiled.records import read, width
from pter_gym._physics.arm import Motion, UnitVector, Vector
from pter_gym.controllers._gains import IMPEDANCE, NOMINAL, Memory, read_gains
from pter_gym.controllers._laws import built_in, built_in_declared, demanded_force
from pter_gym.controllers._policy import CompiledLaw
from pter_gym.controllers._steering import Tip

Array = NDArray[np.float64]

MEMORY_WIDTH = width(Memory)


def desired_forces(
    law: CompiledLaw | None, paces: Array, velocity: Array, heading: Array, error: Array
) -> Array | None:
    """Return the force of the device on the hand that a law demands, (R, N, 2) [N].

    It is that at each control instant, without the noise and delay that sensors add. None for a law
    that demands no force: all but the impedance laws.

    Parameters
    ----------
    law
        The law, or None for a policy that is none.
    paces
        Commanded speeds [m/s], (N,).
    velocity, heading, error
        Of the tip from the reset on: velocity [m/s], (R, N, 2), the path's heading [rad] and the
        distance from the path [m], (R, N).
    """
    if law is None or law.function not in (built_in, built_in_declared):
        return None
    if law.gains[0] != IMPEDANCE:
        return None
    tips = np.stack([*np.moveaxis(velocity, -1, 0), np.cos(heading), np.sin(heading), error], -1)
    forces = np.empty((*error.shape, 2))
    _kernel()(law.gains, paces, tips, forces)
    return forces


def _build(digest: str) -> Any:
    def want(gains: Any, paces: Any, tips: Any, forces: Any) -> None:
        _ = digest
        arm = read(gains, NOMINAL, 0).arm
        memory = np.zeros(MEMORY_WIDTH)
        still = Motion(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
        for world in range(len(paces)):
            g = read_gains(gains, paces[world])
            memory[:] = 0.0
            for step in range(len(tips)):
                row = tips[step, world]
                x, y, cos, sin, error = row[0], row[1], row[2], row[3], row[4]
                tip = Tip(arm, still, Vector(x, y), UnitVector(cos, sin), error, 0.0)
                _, along_x, along_y = demanded_force(g, tip, paces[world], float(step), memory)
                forces[step, world, 0] = along_x
                forces[step, world, 1] = along_y

    return want


@cache
def _kernel() -> Any:
    return compile_kernel(_build)
