"""Sphinx configuration: `sphinx-build docs docs/_build`."""

import runpy
from pathlib import Path

project = "pter_gym"
author = "pter_gym contributors"
copyright = f"2026, {author}"
release = runpy.run_path(str(Path(__file__).parents[1] / "pter_gym" / "_version.py"))["__version__"]
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
