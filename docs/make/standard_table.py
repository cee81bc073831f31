"""Write the table of the paper's standard test: `python docs/make/standard_table.py`."""

import tyro
from pages import ROOT, table, write_block

from pter_gym.benchmark import find_controller, run_standard_test
from pter_gym.params import BASELINE

PAGE = ROOT / "docs" / "reproduction.md"
NAME = "standard test"
POLICIES = ("impedance", "torque-feedback", "free", "locked", "random")
HEAD = (
    "Policy",
    "path error [mm]",
    "mean speed [m/s]",
    "peak tip acceleration [m/s²]",
    "at the end of the path",
    "time [s]",
)


def standard_table() -> str:
    """One line for each policy at the manufacturer's time constant, seed 0."""
    policies = {name: find_controller(name) for name in POLICIES}
    result = run_standard_test(policies, time_constants=[BASELINE.clutch.time_constant])
    rows = []
    for name, (run,) in result.runs.items():
        score = run.score
        numbers = f"{1000 * score.path_error_m:,.1f} {score.mean_speed_m_s:.2f} {score.peak_acceleration_m_s2:.1f}"
        arrives = "yes" if score.completed else "no"
        rows.append([f"`{name}`", *numbers.split(), arrives, f"{score.duration_s:.2f}"])
    return table(list(HEAD), rows)


def main() -> None:
    """Write the table."""
    write_block(PAGE, NAME, standard_table())


if __name__ == "__main__":
    tyro.cli(main)
