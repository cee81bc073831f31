"""Solve the dampers in pter_gym/presets/paces.toml again, after a change of the physics."""

import tyro

from pter_gym.benchmark.pacing import TABLE, solve_table
from pter_gym.internal.files import write_text_atomic

HEAD = [
    "# Dampers along the path [N·s/m] with which the paper's controllers keep the commanded paces on the training",
    "# draws of each scenario; their other gains are those of pter.toml.",
    "# derived: made by `python docs/make/solve_paces.py`.",
]


def main() -> None:
    """Solve the dampers in pter_gym/presets/paces.toml again."""
    lines = HEAD.copy()
    for scenario, controllers in solve_table().items():
        for name, dampers in controllers.items():
            lines += ["", f"[{scenario}.{name}]", *(f"{pace} = {damping!r}" for pace, damping in dampers.items())]
    write_text_atomic(TABLE, "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    tyro.cli(main)
