"""Parameters of a real machine from a log of it, with the compiled simulator as the model.

The log is cut into windows, a machine is fitted to them, and a verdict says whether the model
explains them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
