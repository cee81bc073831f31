"""Solve the dampers in pter_gym/presets/paces.toml anew: `python .ci/solve_paces.py`, after a change of the physics."""

from pter_gym.benchmark.pacing import TABLE, solve_table
from pter_gym.files import write_text_atomic

lines = [
    "# Dampers along the path [N·s/m] with which the paper's controllers keep the commanded paces on random phases of",
    "# Eq. 5; their other gains are those of pter.toml. derived: made by `python .ci/solve_paces.py`.",
]
for name, dampers in solve_table().items():
    lines += ["", f"[{name}]", *(f"{pace} = {damping!r}" for pace, damping in dampers.items())]
write_text_atomic(TABLE, "\n".join(lines) + "\n")
print("\n".join(lines))
