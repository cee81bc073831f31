"""Sphinx configuration: `sphinx-build docs docs/_build`."""

from pathlib import Path

project = "pter_gym"
author = "pter_gym contributors"
copyright = f"2026, {author}"
version: dict[str, str] = {}
exec((Path(__file__).parents[1] / "pter_gym" / "_version.py").read_text(encoding="utf-8"), version)
release = version["__version__"]
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
