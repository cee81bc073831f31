"""From which distance on the shipped laws let go of a clutch that sticks: their gain ``release``.

    python benchmarks/release.py [EPISODES]

For each entry of ``pter_gym/presets/tuned.toml`` of a law with that gain: on training episodes that
no search has seen, what ``pter tune`` minimises, the mean of the worst twentieth and the largest
error, all in mm, for each distance tried. Of the distances whose first number is within 1 % of the
least, the one with the smallest largest error is marked. Gains that decide about one episode in ten
thousand cannot be searched together with the others on 200 episodes.
"""

import sys
from dataclasses import replace

from pter_gym.benchmark import Assessment, evaluate, training_episodes
from pter_gym.benchmark.boards import worst_twentieth
from pter_gym.controllers._steering import Steering
from pter_gym.policies.tuned import controller_of, read_gains

DISTANCES = (0.0, 0.0003, 0.0005, 0.001, 0.002, 0.003, 0.005, 0.01)
"""Those that are tried [m]; 0: never."""

SEED = 2**31 + 2
"""Seed of the training episodes, larger than any of a search."""

SLACK = 1.01


def main(episodes: int = 1000) -> None:
    """Print a row for each entry and distance."""
    for scenario, laws in read_gains().items():
        for name, paces in laws.items():
            for pace, entry in paces.items():
                law = controller_of(name, entry, "tuned.toml")
                if isinstance(law, Steering):
                    drawn = training_episodes(scenario, pace, episodes, SEED)
                    print(f"{scenario} {name} {pace}", flush=True)
                    choose(law, drawn)


def choose(law, drawn) -> None:
    """Print a row for each distance, the chosen one marked."""
    rows = []
    for distance in DISTANCES:
        tried = replace(law, release=distance)
        scores = evaluate(tried, drawn, 1, ranking=True)
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
