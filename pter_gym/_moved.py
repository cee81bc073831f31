"""Where modules have moved since version 0.1.0: their old names still import."""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, spec_from_loader
from types import CodeType, MappingProxyType, ModuleType
from typing import Any

MOVED = MappingProxyType(
    {
        "pter_gym.benchmark.speed": "pter_gym.speed",
        "pter_gym.cli": "pter_gym.commands.main",
        "pter_gym.envs.batch": "pter_gym.engine.batch",
        "pter_gym.experiments": "pter_gym.paper.experiments",
        "pter_gym.layout": "pter_gym.compiled.layout",
        "pter_gym.open_loop": "pter_gym.physics.open_loop",
        "pter_gym.operators": "pter_gym.hands",
        "pter_gym.plots.paper": "pter_gym.paper.plots",
        "pter_gym.predictive": "pter_gym.controllers.predictive",
        "pter_gym.randomisation": "pter_gym.scenarios.randomisation",
        "pter_gym.reproduce": "pter_gym.paper.reproduce",
        "pter_gym.sb3": "pter_gym.envs.sb3",
    }
)
"""New name of each module by its old one; what a package holds has moved with it."""


def new_name(name: str) -> str | None:
    """Return where a module is that is called by its old name, None for any other name."""
    return next((new + name[len(old) :] for old, new in MOVED.items() if f"{name}.".startswith(f"{old}.")), None)


class _OldNames(MetaPathFinder, Loader):
    """Finds a module under its old name: the very module, not a copy."""

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        """Return a spec for an old name, None for any other."""
        return spec_from_loader(fullname, self) if new_name(fullname) else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module under its new name."""
        module = import_module(str(new_name(spec.name)))
        spec.loader_state = module.__spec__
        return module

    def get_code(self, fullname: str) -> CodeType | None:
        """Return the code of a module, for ``python -m``."""
        spec: Any = find_spec(str(new_name(fullname)))
        return spec.loader.get_code(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its own spec back, which the import system has replaced."""
        spec = module.__spec__
        if spec is not None:
            module.__spec__ = spec.loader_state


def find_old_names() -> None:
    """Let old names of modules be imported."""
    sys.meta_path.insert(0, _OldNames())  # first, or the modules of a moved package would load twice
