"""Paths to follow: planar curves parametrised by arc length, stored as chains of circular arcs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
