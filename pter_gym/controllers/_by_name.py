"""The built-in laws by name, loaded."""

from pter_gym import controllers
from pter_gym.controllers._names import LAWS
from pter_gym.controllers._policy import Controller

CONTROLLERS: dict[str, type[Controller]] = {
    name: getattr(controllers, kind) for name, kind in LAWS.items()
}
"""The built-in controllers by name."""
