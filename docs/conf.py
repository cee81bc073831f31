"""Sphinx configuration: `sphinx-build docs docs/_build`.

`PTER_DOCS_EXECUTE=1` runs the notebooks, which takes minutes and needs the extra `agents`; without
it their pages show what is in them. `-b linkcheck` looks up the links that leave the site."""

import os
import runpy
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS.parent / "agents"), str(DOCS / "make")]

project = "pter_gym"
author = "pter_gym contributors"
copyright = f"2026, {author}"
release = runpy.run_path(str(DOCS.parent / "pter_gym" / "_version.py"))["__version__"]
address = tomllib.loads((DOCS.parent / "pyproject.toml").read_text("utf-8"))["project"]["urls"][
    "Source"
]
is_public = not address.endswith(".example")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "extension",
]
exclude_patterns = ["_build", "_templates", "make"]
templates_path = ["_templates"]

myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "cache" if os.environ.get("PTER_DOCS_EXECUTE") == "1" else "off"
nb_execution_timeout = 1800
nb_execution_raise_on_error = True

napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_typehints_format = "short"
autodoc_mock_imports = [
    name for name in ("optuna", "stable_baselines3", "torch") if find_spec(name) is None
]
add_module_names = False
python_maximum_signature_line_length = 80
toc_object_entries_show_parents = "hide"
html_math_renderer = "mathml"

html_theme = "furo"
html_title = f"pter_gym {release}"
html_logo = html_favicon = "../pter_gym/tools/web/static/icon.svg"
html_theme_options = {
    "footer_icons": [{"name": "Source", "url": address, "html": "Source", "class": ""}]
    if is_public
    else []
}
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False

linkcheck_anchors = False
linkcheck_timeout = 20


def add_page(app: Any, error: Exception | None) -> None:
    """Put the page of `pter play` beside the built pages, where `push-it-yourself.md` shows it."""
    from pter_gym.tools.web.site import write_site

    if error is None and app.builder.format == "html":
        write_site(Path(app.outdir) / "push")


def setup(app: Any) -> None:
    app.connect("build-finished", add_page)
