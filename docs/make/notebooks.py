"""Run notebooks and store what they print and draw, so that whoever reads them on a code host sees it.

python docs/make/notebooks.py           all of them, which takes some minutes
python docs/make/notebooks.py 01 03     those whose names begin so
"""

import sys
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient
from pages import ROOT

from pter_gym._internal.files import write_text_atomic

NOTEBOOKS = ROOT / "notebooks"


def run(notebook: nbformat.NotebookNode) -> None:
    """Run a notebook in a folder of its own and keep what it shows, without times and what it says of its progress."""
    with TemporaryDirectory() as folder:
        NotebookClient(
            notebook, timeout=1800, kernel_name="python3", resources={"metadata": {"path": folder}}, record_timing=False
        ).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [each for each in cell.outputs if each.get("name") != "stderr"]


def main(chosen: tuple[str, ...]) -> None:
    """Run notebooks whose names begin as is asked for."""
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        if path.name.startswith(chosen):
            notebook = nbformat.read(path, as_version=4)
            metadata = dict(notebook.metadata)
            run(notebook)
            notebook.metadata = nbformat.from_dict(metadata)
            write_text_atomic(path, nbformat.writes(notebook) + "\n")
            print(path.name)


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or ("",))
