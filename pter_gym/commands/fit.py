"""``pter fit``: the search for values that the paper does not print."""

from pathlib import Path

from rich.console import Console


def fit(seed: int = 0, budget: int = 60_000, held_out: bool = False, out: Path = Path("pter-preset.toml")) -> None:
    """Search for values that the paper does not print, by its Table I and its trends, and write them as a preset.

    Args:
        seed: Seed of the search, at least 0; the same seed and budget give the same result.
        budget: Evaluated candidates, at least 300.
        held_out: Fit Table I alone and keep the trends held out.
        out: File for the preset; its folder must exist.
    """
    from pter_gym.paper.experiments.calibration import FitArguments
    from pter_gym.paper.experiments.calibration import fit as search

    result = search(FitArguments(seed=seed, budget=budget, held_out=held_out, out=out))
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"misfit {result.misfit:.4f}; Table I in the paper's units: {result.table.round(3).tolist()}")
    console.print(f"wrote {out}")
