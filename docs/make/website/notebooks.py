"""Brings the notebooks into the source of the site: git holds them once, in `notebooks`."""

import shutil
from pathlib import Path

from sphinx.application import Sphinx


def bring(app: Sphinx) -> None:
    """Copy what has changed into `docs/notebooks`, and take away what is gone."""
    here = Path(app.srcdir) / "notebooks"
    here.mkdir(exist_ok=True)
    notebooks = {path.name: path for path in (Path(app.srcdir).parent / "notebooks").glob("*.ipynb")}
    for name, path in notebooks.items():
        if not (here / name).exists() or (here / name).read_bytes() != path.read_bytes():
            shutil.copyfile(path, here / name)
    for copied in here.glob("*.ipynb"):
        if copied.name not in notebooks:
            copied.unlink()


def setup(app: Sphinx) -> dict[str, bool]:
    """Bring the notebooks before pages are looked for."""
    app.connect("builder-inited", bring)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
