"""``pter fit``: the search for values that the paper does not print."""

from pathlib import Path

from pter_gym._commands.arguments import check_file
from pter_gym._internal.terminal import say


def fit(seed: int = 0, budget: int = 20_000, trends: float = 0.3, out: Path = Path("pter-preset.toml")) -> None:
    """Search for values that the paper does not print.

    The search fits its Table I and its trends, and writes the result as a preset.

    Example: pter fit --budget 3000 --out preset.toml

    Args:
        seed: Seed of the search, at least 0; the same seed and budget give the same result.
        budget: Evaluated candidates, at least 1,000.
        trends: Weight of the trends over the time constant relative to Table I, at least 0.
        out: File for the preset, in TOML; its folder must exist.
    """
    check_file(out, ".toml")
    import numpy as np

    from pter_gym.tools.paper.experiments.calibration import TARGET
    from pter_gym.tools.paper.experiments.calibration import fit as search

    result = search(seed=seed, budget=budget, trends=trends, out=out)
    found = result.quality
    say(f"misfit {result.misfit:.4f}; Table I in the paper's units: {found.table[0].round(3).tolist()}")
    worst = f"{100.0 * float(np.abs(found.table[0] / TARGET - 1.0).max()):.1f}%"
    say(f"worst entry {worst} off; trends of error, path length, speed, peak: {found.trends[0].round(2).tolist()}")
    say(f"wrote {out}")
