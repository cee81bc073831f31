"""The hand that holds the tip: kinds of hands, a library, and constants for the kernels."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
