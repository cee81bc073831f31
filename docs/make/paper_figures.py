"""Draw the paper's figures for the gallery, with its claims beside them: `python docs/make/paper_figures.py`.

It runs the experiments of `pter reproduce` and writes its pictures and `claims.json` to docs/images/paper.
"""

import tyro
from pages import IMAGES

from pter_gym.internal.files import write_files_atomic
from pter_gym.paper.experiments import Study
from pter_gym.paper.reproduce.figures import PRODUCTS
from pter_gym.paper.reproduce.results import results

PAPER = IMAGES / "paper"


def main() -> None:
    """Draw the paper's figures and check its claims."""
    files, _ = results(Study(), PRODUCTS, print)
    kept = {name: content for name, content in files.items() if name.endswith((".png", "claims.json"))}
    write_files_atomic(PAPER, kept)


if __name__ == "__main__":
    tyro.cli(main)
