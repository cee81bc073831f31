"""From which distance on tuned laws should let go of a clutch that sticks: their gain ``release``.

    python benchmarks/release.py [EPISODES]

For each scenario, law with that gain and pace, with the gains that serve there: on training
episodes that no search has seen, what ``pter tune`` minimises, the mean of the worst twentieth and
the largest error, all in mm, for each distance. Of the distances whose first number is within 1 %
of the least, the one with the smallest largest error is marked. What decides about one episode in
ten thousand cannot be searched together with the other gains on 200 episodes.
"""

import sys
from dataclasses import replace

from pter_gym.benchmark import Assessment, Episodes, evaluate, training_episodes
from pter_gym.benchmark.boards import worst_twentieth
from pter_gym.controllers import PaceSchedule, SingleDof, VelocityRatio
from pter_gym.policies.tuned import find_tuned
from pter_gym.scenarios import PACES, SCENARIOS

DISTANCES = (0.0, 0.0003, 0.0005, 0.001, 0.002, 0.003, 0.005, 0.01)
"""Those that are tried [m]; 0: never."""

SEED = 2**31 + 2
"""Seed of the training episodes, larger than any of a search."""

SLACK = 1.01


def main(episodes: int = 1000) -> None:
    """Print a row for each scenario, law, pace and distance."""
    for scenario in SCENARIOS:
        for name in ("velocity-ratio-tuned", "single-dof-tuned"):
            for pace, speed in PACES.items():
                schedule = find_tuned(name, scenario)
                law = schedule.at(speed) if isinstance(schedule, PaceSchedule) else None
                if isinstance(law, SingleDof | VelocityRatio):
                    print(f"{scenario} {name} {pace}", flush=True)
                    choose(law, training_episodes(scenario, pace, episodes, SEED))


def choose(law: SingleDof | VelocityRatio, drawn: Episodes) -> None:
    """Print a row for each distance, the chosen one marked."""
    rows: list[tuple[float, float, float]] = []
    for distance in DISTANCES:
        scores = evaluate(replace(law, release=distance), drawn, 1, ranking=True)
        means = {name: float(scores[name].mean()) for name in Assessment._fields}
        errors = scores["path_error_m"]
        rows.append((Assessment(**means).value, worst_twentieth(errors), float(errors.max())))
    least = min(value for value, _, _ in rows)
    chosen = min((row for row in rows if row[0] <= SLACK * least), key=lambda row: row[2])
    for distance, row in zip(DISTANCES, rows, strict=True):
        numbers = "".join(f"{1e3 * number:9.2f}" for number in row)
        print(f"  {1e3 * distance:5.1f} mm{numbers}{'  *' if row is chosen else ''}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
