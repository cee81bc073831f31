"""Docstrings as the API reference shows them: with the fields of parameters, and of names that a package re-exports."""

import inspect
from collections.abc import Iterable
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

PAGES = {"pter_gym.envs.single.PathFollowingEnv": "/path-following"}
"""Classes whose docstring is a page in Markdown."""


class Sample(NamedTuple):
    """Any named tuple: its field is of the type that all their fields have."""

    field: int


def process(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Change the lines of a docstring in place."""
    if name in PAGES:
        lines[:] = [lines[0], "", f":doc:`{PAGES[name]}` has actions, observations, rewards and episodes.", ""]
    elif what == "data":
        lines[:] = data_docstring(name)
    elif inspect.isclass(obj) and is_dataclass(obj):
        if (obj.__doc__ or "").startswith(f"{obj.__name__}("):
            lines.clear()  # what dataclasses write where there is no docstring
        lines.extend(fields_table(obj))


def data_docstring(name: str) -> list[str]:
    """Lines below the definition of a name, in the module that is named or in one of its package."""
    module, _, variable = name.rpartition(".")
    for each in [module, *submodules(module)]:
        found = ModuleAnalyzer.for_module(each).find_attr_docs().get(("", variable))
        if found:
            return found
    return []


def submodules(module: str) -> Iterable[str]:
    """Names of the modules in a package."""
    path = Path(ModuleAnalyzer.get_module_source(module)[0] or "")
    if path.name == "__init__.py":
        yield from sorted(f"{module}.{each.stem}" for each in path.parent.glob("[!_]*.py"))


def fields_table(owner: Any) -> Iterable[str]:
    """Rows of a table of the fields that say their unit and where their value comes from."""
    told = [item for item in fields(owner) if "provenance" in item.metadata]
    if not told:
        return
    yield from ("", ".. list-table::", "   :header-rows: 1", "")
    for row in [("Field", "Unit", "Default", "Provenance"), *map(field_row, told)]:
        cells = (cell.replace("|", r"\|") for cell in row)
        yield from (f"   {'* -' if place == 0 else '  -'} {cell}" for place, cell in enumerate(cells))
    yield ""


def field_row(item: Any) -> tuple[str, ...]:
    """Name, unit, default and provenance of a field."""
    return f"``{item.name}``", item.metadata["unit"], default(item), item.metadata["provenance"]


def default(item: Any) -> str:
    """The default of a field: a number or a word, or the class of a default record."""
    if item.default is MISSING:
        return "none"
    if isinstance(item.default, (int, float)):
        return f"{item.default:g}"
    return f"``{item.default!r}``" if isinstance(item.default, (str, tuple)) else f"``{type(item.default).__name__}()``"


def choose(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Show public data of a module, whose docstring `process` finds; leave out what NamedTuple says of its fields."""
    if isinstance(obj, type(Sample.field)):
        return True
    is_data = what == "module" and not (inspect.ismodule(obj) or inspect.isroutine(obj) or inspect.isclass(obj))
    return False if is_data and not name.startswith("_") and name.isupper() else None


def follow(app: Sphinx, module: str, attribute: str) -> str | None:
    """Where the source of a name is: data of built-in types are where they are documented."""
    value = getattr(import_module(module), attribute.partition(".")[0], None)
    return module if getattr(value, "__module__", "builtins") == "builtins" else None


def unlink(app: Sphinx, doctree: nodes.document) -> None:
    """Leave names of results and attributes alone: Sphinx would link each to anything that is called the same."""
    for link in list(doctree.findall(addnodes.pending_xref)):
        if link["refdomain"] == "py" and link["reftarget"].islower() and "." not in link["reftarget"]:
            link.replace_self(link.children)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("autodoc-process-docstring", process)
    app.connect("viewcode-follow-imported", follow)
    app.connect("doctree-read", unlink)
    app.connect("autodoc-skip-member", choose)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
