"""Machines, tasks and all that they consist of as plain data."""

from functools import cache

from pter_gym import hands, params, paths
from pter_gym._internal.codec import Codec, dataclasses_in
from pter_gym.tasks import path_following


@cache
def codec() -> Codec:
    """Return what turns their dataclasses into plain data and back."""
    return Codec(dataclasses_in(params, hands, paths, path_following))
