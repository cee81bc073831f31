"""The built-in laws by name, loaded."""

from pkgutil import resolve_name

from pter_gym.controllers._names import LAWS
from pter_gym.controllers._policy import Controller

CONTROLLERS: dict[str, type[Controller]] = {
    name: resolve_name(f"pter_gym.controllers.{place}") for name, place in LAWS.items()
}
"""The built-in controllers by name."""
