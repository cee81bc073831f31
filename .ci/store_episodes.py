"""Make the stored evaluation episodes in pter_gym/episodes anew. They change every published score: raise VERSION."""

import math

import numpy as np

from pter_gym.benchmark.episodes import store_episodes
from pter_gym.operators import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing

VERSION = 0
COUNT = 200

generator = np.random.default_rng(20261120)
phases = [tuple(row) for row in generator.uniform(0.0, 2.0 * math.pi, (COUNT, 5)).tolist()]
tasks = [PathFollowing(hand=MultiSineHand(phases=each)) for each in phases]
path = store_episodes("standard", [BASELINE] * COUNT, tasks, list(range(COUNT)), ["eq5"] * COUNT, version=VERSION)
print(path, path.stat().st_size)
