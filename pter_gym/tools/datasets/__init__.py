"""Data sets for offline learning: episodes of policies at several skill levels, in Minari's format.

``pter record`` writes them. Only training draws are used, never the episodes on which policies are compared.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.tools.datasets.levels import LEVELS, Actor, actors_of
    from pter_gym.tools.datasets.recording import Episode, record_episodes
    from pter_gym.tools.datasets.writing import dataset_id, write_dataset

__all__ = ["LEVELS", "Actor", "Episode", "actors_of", "dataset_id", "record_episodes", "write_dataset"]

__getattr__, __dir__, _ = lazy_loader.attach(  # pyright: ignore[reportUnknownVariableType]
    __name__,
    submod_attrs={
        "levels": ["LEVELS", "Actor", "actors_of"],
        "recording": ["Episode", "record_episodes"],
        "writing": ["dataset_id", "write_dataset"],
    },
)
