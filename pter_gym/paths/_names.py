"""Names of paths, without loading anything that compiles."""

PATH_NAMES = ("line", "arc", "circle", "sine")
"""Names of paths, in their order in ``PATHS``."""
