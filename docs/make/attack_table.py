"""Write the list of attacks in docs/trust.md: `PYTHONPATH=tests python docs/make/attack_table.py`."""

import tyro
from pages import ROOT, table, write_block

PAGE = ROOT / "docs" / "trust.md"
NAME = "attacks"


def attack_table() -> str:
    """Every attack of the corpus, by what it attacks."""
    from benchmark.corpus import CORPUS

    rows = [[what, "; ".join(names).replace("|", r"\|")] for what, names in CORPUS.items()]
    return table(["What is attacked", "Attacks"], rows, "---")


def main() -> None:
    """Write the list of attacks."""
    write_block(PAGE, NAME, attack_table())


if __name__ == "__main__":
    tyro.cli(main)
