"""``pter fit``: the search for values that the paper does not print."""

from pathlib import Path

from pter_gym._commands.arguments import check_file
from pter_gym._internal.terminal import say


def fit(seed: int = 0, budget: int = 60_000, held_out: bool = False, out: Path = Path("pter-preset.toml")) -> None:
    """Search for values that the paper does not print.

    They are found by its Table I and its trends, and written as a preset.

    Example: pter fit --budget 3000 --out preset.toml

    Args:
        seed: Seed of the search, at least 0; the same seed and budget give the same result.
        budget: Evaluated candidates, at least 300.
        held_out: Fit Table I alone and keep the trends held out.
        out: File for the preset, in TOML; its folder must exist.
    """
    from pter_gym.tools.paper.experiments.calibration import fit as search

    check_file(out, ".toml")
    result = search(seed=seed, budget=budget, held_out=held_out, out=out)
    say(f"misfit {result.misfit:.4f}; Table I in the paper's units: {result.table.round(3).tolist()}")
    say(f"wrote {out}")
