"""What a passive haptic device can render, and how well it did so.

``force_region`` and its relatives return the forces that the clutches of a machine can exert at the
handle, from geometry and torque curves alone. The other functions are scores of time series, logged
or simulated.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
