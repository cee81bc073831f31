"""Fields of a task as arguments of an environment, where names stand for paths, paces and starts."""

from typing import Any

from pter_gym.paths import find_path
from pter_gym.scenarios import find_pace
from pter_gym.tasks.path_following import PathFollowing, find_starts
from pter_gym.tasks.path_following._specification import largest_error_max


def overrides_of_task(**given: Any) -> dict[str, Any]:
    """Return the fields of a task that are given; paths, paces and starts may be names.

    About a path that is given without ``error_max``, the workspace is at most as wide as its
    curvature allows.
    """
    found = {name: value for name, value in given.items() if value is not None}
    for name, find in {"path": find_path, "pace": find_pace, "starts": find_starts}.items():
        if name in found:
            found[name] = find(found[name])
    if "path" in found and "error_max" not in found:
        found["error_max"] = min(PathFollowing.error_max, largest_error_max(found["path"]))
    return found
