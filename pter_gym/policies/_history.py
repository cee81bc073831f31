"""Observations of some control steps ago, which may be appended to an observation.

The functions are those of worlds, of policies and, with JAX's arrays, of ``pter_gym.envs.jax``.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._internal.checks import are_rising
from pter_gym.errors import ParameterError

if TYPE_CHECKING:
    import jax

Floats = TypeVar("Floats", NDArray[np.float32], "jax.Array")

MAX_HISTORY = 200
"""Most control steps that an observation may look back."""


def checked_history(history: object) -> tuple[int, ...]:
    """Return the control steps of a history, or raise a ParameterError."""
    several = isinstance(history, Sequence) and not isinstance(history, str)
    steps = tuple(cast("Sequence[object]", history)) if several else (0,)
    if not are_rising(steps, MAX_HISTORY):
        raise ParameterError(
            f"history must be rising whole numbers from 1 to {MAX_HISTORY}, got {history!r:.200}"
        )
    return cast("tuple[int, ...]", steps)


class History:
    """The latest observations of N worlds, (N, steps, entries), and what is seen of them.

    Attributes
    ----------
    layout
        Layout of what is seen: the present observation, then the earlier ones, whose entries are
        called ``normal_error[-3]``.
    """

    def __init__(self, steps: tuple[int, ...], layout: Layout) -> None:
        earlier = (
            replace(
                field,
                name=f"{field.name}[-{ago}]",
                meaning=f"{field.meaning}, {ago} control steps ago",
            )
            for ago in steps
            for field in layout.fields
        )
        self.layout = Layout((*layout.fields, *earlier))
        self.shape = max((0, *steps)) + 1, len(layout)
        self._ages = np.array((0, *steps))

    def after(self, latest: Floats, obs: Floats, begins: "NDArray[np.bool_] | jax.Array") -> Floats:
        """Return the latest observations after another one, the newest first.

        Where an episode ``begins``, (N,), all of them are its first observation.
        """
        library, present = obs.__array_namespace__(), obs[:, None]
        moved = library.concat([present, latest[:, :-1]], axis=1)
        return library.where(begins[:, None, None], present, moved)

    def seen(self, latest: Floats) -> Floats:
        """Return the present observations and the earlier ones after them, (N, entries)."""
        return latest[:, self._ages].reshape(len(latest), -1)
