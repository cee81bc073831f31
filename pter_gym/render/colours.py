"""The colours of a gif: of pictures with flat colours the most frequent ones, as they are."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST = 64
"""Colours of a palette: more of them make a file larger and look no better."""


class Colours:
    """A palette for pictures, uint8 (height, width, 3), made from some of them."""

    def __init__(self, pictures: Sequence[NDArray[np.uint8]]) -> None:
        numbers, counts = np.unique(np.concatenate([_numbers(picture) for picture in pictures]), return_counts=True)
        self._known = np.sort(numbers[np.argsort(-counts, kind="stable")[:MOST]])
        self._rgb = _rgb(self._known)

    def image(self, picture: NDArray[np.uint8]) -> Any:
        """Return a picture as Pillow's image with this palette; a colour that is not in it becomes the nearest."""
        from PIL import Image

        height, width, _ = picture.shape
        image = Image.frombytes("P", (width, height), self.entries(picture).tobytes())
        image.putpalette(self._rgb.astype(np.uint8).tobytes())
        return image

    def entries(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the numbers of a picture's colours in the palette, shape (height, width)."""
        numbers = _numbers(picture)
        found = np.searchsorted(self._known, numbers).clip(max=len(self._known) - 1)
        other = self._known[found] != numbers
        strangers, back = np.unique(numbers[other], return_inverse=True)
        if len(strangers):
            found[other] = self._nearest(_rgb(strangers))[back]
        return found.astype(np.uint8).reshape(picture.shape[:2])

    def _nearest(self, rgb: NDArray[np.int32]) -> NDArray[np.intp]:
        """Return the entries that are nearest to colours (K, 3)."""
        return np.concatenate(
            [((part[:, None] - self._rgb) ** 2).sum(axis=2).argmin(axis=1) for part in np.array_split(rgb, 8)]
        )


def _numbers(picture: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return the colours of a picture as numbers, one for each pixel."""
    return (picture.reshape(-1, 3).astype(np.int32) * (65536, 256, 1)).sum(axis=1, dtype=np.int32)


def _rgb(numbers: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return numbers as colours, shape (K, 3)."""
    return np.stack([numbers >> 16, (numbers >> 8) & 255, numbers & 255], axis=1)
