"""What a passive haptic device can render, and how well it did.

``force_region`` and its relatives say which forces at the handle the clutches of a machine can
make, from geometry and torque curves alone. The other functions are scores of time series, logged
or simulated.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
