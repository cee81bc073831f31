"""Pictures and films of a PTER at work: telemetry in, pixels out. A window needs pygame, from the extra ``render``."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pter_gym.tools.pictures.render.viewer import Mode, Viewer

__all__ = ["Mode", "Viewer"]


def __getattr__(name: str) -> Any:
    """Load the viewer on first use: an environment that draws nothing loads no drawing code."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from pter_gym.tools.pictures.render import viewer

    return getattr(viewer, name)
