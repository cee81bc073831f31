"""Values of any kind by their bits, and the memory that they share."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def is_mapping(value: Any) -> bool:
    """Tell whether a value holds others by name."""
    return isinstance(value, Mapping)


def parts_of(value: Any) -> list[Any] | None:
    """Return what a container holds, None for anything else."""
    if is_mapping(value):
        return [value[key] for key in sorted(value)]
    listed = getattr(value, "dtype", None) == np.dtype(object) or issubclass(type(value), (tuple, list))
    return list(value) if listed else None


def bits_of(value: Any) -> Any:
    """Return something that is equal for equal bits."""
    parts = parts_of(value)
    if parts is not None:
        names = tuple(sorted(value)) if is_mapping(value) else None
        return names, tuple(bits_of(part) for part in parts)
    if isinstance(value, (np.ndarray, np.generic)):
        return value.dtype.str, value.shape, value.tobytes()
    return type(value).__name__, repr(value)


def leaves_of(value: Any) -> Iterator[NDArray[Any]]:
    """Return all arrays within a value."""
    if isinstance(value, np.ndarray):
        yield value
    for part in parts_of(value) or ():
        yield from leaves_of(part)


def shares(one: Any, other: Any) -> bool:
    """Tell whether an array within one value shares memory with an array within the other."""
    others = list(leaves_of(other))
    return any(np.shares_memory(leaf, each) for leaf in leaves_of(one) for each in others)


def scribble(value: Any) -> None:
    """Write over all arrays within a value."""
    for leaf in leaves_of(value):
        if leaf.flags.writeable and leaf.dtype.kind in "biuf":
            leaf.fill(1)


def info_of(infos: Mapping[str, Any], world: int) -> dict[str, Any]:
    """Return what ``infos`` tells about one world, going by the masks."""
    told: dict[str, Any] = {}
    for key, value in infos.items():
        mask = infos.get(f"_{key}")
        if mask is not None and mask[world]:
            told[key] = info_of(value, world) if is_mapping(value) else value[world]
    return told
