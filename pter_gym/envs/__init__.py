"""Interfaces to the simulator: Gymnasium's single and vector environments.

``sb3`` is for Stable-Baselines3, ``jax`` for JAX.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
