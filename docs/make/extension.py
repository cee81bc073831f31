"""Our part of Sphinx: formulas as MathML, notebooks, and docstrings with tables of fields."""

import inspect
import re
import shutil
from collections.abc import Iterable
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from contents import add_contents
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

PAGES = {"pter_gym.envs._single.PathFollowingEnv": "/environment"}
"""Classes whose docstring is a page in Markdown."""

COMMAND = re.compile(r"(pter|pip|python3?|docker|\w+=\w+ \S+|\.venv/bin/\w+) ")
"""How a block of commands begins."""

COMMANDS = r'<div class="highlight-(?:sh|text|powershell).*?</pre>'
"""A block of commands in a page."""


def inline_formula(translator: Any, node: nodes.math) -> None:
    """Write a formula within a line as MathML, which browsers draw by themselves."""
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def formula(translator: Any, node: nodes.math_block) -> None:
    """Write a formula on lines of its own."""
    translator.body.append(
        f'<div class="equation">{tex2mathml(node.astext(), as_block=True)}</div>'
    )
    raise nodes.SkipNode


def bring_notebooks(app: Sphinx) -> None:
    """Copy the notebooks, which git has once, into the source of the site, if they have changed."""
    here, notebooks = Path(app.srcdir) / "notebooks", Path(app.srcdir).parent / "notebooks"
    here.mkdir(exist_ok=True)
    for path in here.glob("*.ipynb"):
        if not (notebooks / path.name).exists():
            path.unlink()
    for path in notebooks.glob("*.ipynb"):
        if not (here / path.name).exists() or (here / path.name).read_bytes() != path.read_bytes():
            shutil.copyfile(path, here / path.name)


class Sample(NamedTuple):
    """Any named tuple: its field is of the type that all their fields have."""

    field: int


def process(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Change the lines of a docstring in place."""
    if inspect.isclass(obj) and f"{obj.__module__}.{obj.__qualname__}" in PAGES:
        page = PAGES[f"{obj.__module__}.{obj.__qualname__}"]
        lines[:] = [
            lines[0],
            "",
            f":doc:`{page}` has actions, observations, rewards and episodes.",
            "",
        ]
    elif what == "data":
        lines[:] = data_docstring(name)
    elif inspect.isclass(obj) and is_dataclass(obj):
        if (obj.__doc__ or "").startswith(f"{obj.__name__}("):
            lines.clear()  # what dataclasses write where there is no docstring
        lines.extend(fields_table(obj))


def data_docstring(name: str) -> list[str]:
    """Return the lines below the definition of a name in a module, or in one of its package."""
    module, _, variable = name.rpartition(".")
    path = Path(ModuleAnalyzer.get_module_source(module)[0] or "")
    files = sorted(path.parent.glob("*.py")) if path.stem == "__init__" else []
    inner = [f"{module}.{file.stem}" for file in files if file.stem != "__init__"]
    for source in [module, *inner]:
        if lines := ModuleAnalyzer.for_module(source).find_attr_docs().get(("", variable)):
            return lines
    return []


def fields_table(owner: Any) -> Iterable[str]:
    """Yield a table of the fields that say their unit and where their value comes from."""
    rows = [
        (f"``{item.name}``", item.metadata["unit"], default(item), item.metadata["provenance"])
        for item in fields(owner)
        if "provenance" in item.metadata
    ]
    yield from ("", ".. list-table::", "   :header-rows: 1", "") if rows else ()
    for row in [("Field", "Unit", "Default", "Provenance"), *rows] if rows else ():
        cells = (cell.replace("|", r"\|") for cell in row)
        yield from (
            f"   {'* -' if place == 0 else '  -'} {cell}" for place, cell in enumerate(cells)
        )
    yield ""


def default(item: Any) -> str:
    """Return the default of a field: a number or a word, or the class of a default record."""
    if item.default is MISSING:
        return "none"
    if isinstance(item.default, (int, float)):
        return f"{item.default:g}"
    if isinstance(item.default, (str, tuple)):
        return f"``{item.default!r}``"
    return f"``{type(item.default).__name__}()``"


def choose(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Show public data of a module; leave out what NamedTuple says of its fields."""
    if isinstance(obj, type(Sample.field)):
        return True
    is_data = what == "module" and not (
        inspect.ismodule(obj) or inspect.isroutine(obj) or inspect.isclass(obj)
    )
    return False if is_data and not name.startswith("_") and name.isupper() else None


def follow(app: Sphinx, module: str, attribute: str) -> str | None:
    """Return where the source of a name is; data of built-in types are where they are defined."""
    value = getattr(import_module(module), attribute.partition(".")[0], None)
    return module if getattr(value, "__module__", "builtins") == "builtins" else None


def unlink(app: Sphinx, doctree: nodes.document) -> None:
    """Leave names of results and attributes alone: Sphinx would link each to any namesake."""
    for link in list(doctree.findall(addnodes.pending_xref)):
        if (
            link["refdomain"] == "py"
            and link["reftarget"].islower()
            and "." not in link["reftarget"]
        ):
            link.replace_self(link.children)


def tell_commands(app: Sphinx, doctree: nodes.document) -> None:
    """Make blocks that begin with a command text, which breaks rather than leaves the page."""
    for block in doctree.findall(nodes.literal_block):
        if COMMAND.match(block.astext()) and block.get("language") in (None, "none", "default"):
            block["language"] = "text"


def shorten_side_bar(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any
) -> None:
    """Show the chapters' pages in the side bar, none of those below them."""
    if whole := context.get("toctree"):
        context["toctree"] = lambda **options: whole(**options | {"maxdepth": 1})


def keep_words_whole(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any
) -> None:
    """Mark names and options, which browsers would break after a hyphen."""
    if body := context.get("body"):
        body = re.sub(r'<span class="pre(?=">[^<]{1,34}<)', r"\g<0> word", body)
        context["body"] = re.sub(COMMANDS, mark_options, body, flags=re.DOTALL)


def mark_options(block: re.Match[str]) -> str:
    """Return a block of commands with its options marked."""
    return re.sub(r"(?<=[\s>])--[\w-]+", r'<span class="word">\g<0></span>', block[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.add_html_math_renderer("mathml", (inline_formula, None), (formula, None))
    app.connect("builder-inited", bring_notebooks)
    app.connect("source-read", add_contents)
    app.connect("html-page-context", shorten_side_bar, priority=400)  # before the theme reads it
    app.connect("html-page-context", keep_words_whole)
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-skip-member", choose)
    app.connect("viewcode-follow-imported", follow)
    app.connect("doctree-read", unlink)
    app.connect("doctree-read", tell_commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
