"""What a source file means, whatever its comments and layout."""

import ast
import tomllib
from pathlib import Path
from typing import cast


def meaning_of(path: Path) -> str:
    """Return the content of a Python or TOML file as plain data in text, without docstrings.

    It depends neither on comments and layout nor on the version of Python.
    """
    text = path.read_text("utf-8")
    return repr(tomllib.loads(text) if path.suffix == ".toml" else _meaning(ast.parse(text)))


def _meaning(node: object) -> object:
    """Return a syntax tree as plain data without docstrings; what is absent in some versions of Python is left out."""
    if isinstance(node, list):
        return [_meaning(each) for each in cast("list[object]", node) if not _is_docstring(each)]
    if not isinstance(node, ast.AST):
        return repr(node)
    parts = ((name, _meaning(value)) for name, value in ast.iter_fields(node) if value not in (None, []))
    return [type(node).__name__, *parts]


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
