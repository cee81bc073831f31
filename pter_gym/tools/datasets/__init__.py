"""Data sets for offline learning: episodes of policies of several levels, in Minari's format.

``pter record`` writes them. Only training draws are used, never the episodes on which policies are compared.
"""

from pter_gym.tools.datasets.levels import LEVELS, Actor, actors_of
from pter_gym.tools.datasets.recording import Episode, record_episodes
from pter_gym.tools.datasets.writing import dataset_id, write_dataset

__all__ = ["LEVELS", "Actor", "Episode", "actors_of", "dataset_id", "record_episodes", "write_dataset"]
