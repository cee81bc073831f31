"""Score the shipped gains again, after the score or the simulator has changed: `python docs/make/rescore_gains.py`."""

from typing import Any

import tyro

from pter_gym.benchmark.tuned import TABLE, controller_of, read_table
from pter_gym.internal.files import write_text_atomic
from pter_gym.tuning.examination import Examination


def scores(scenario: str, name: str, pace: str, entry: dict[str, Any]) -> dict[str, float]:
    """Return the scores of an entry on the draws that follow those of its search."""
    words = entry["command"].split()
    seed = int(words[words.index("--seed") + 1])
    exam = Examination(scenario, pace, entry["episodes"], 2 * seed + 1)
    return exam.judge(controller_of(name, entry, TABLE))._asdict()


def main() -> None:
    """Write the scores into the table of gains; all else stays."""
    text = TABLE.read_text("utf-8")
    for scenario, controllers in read_table().items():
        for name, paces in controllers.items():
            for pace, entry in paces.items():
                begin = text.index(f"[{scenario}.{name}.{pace}]")
                head, gains, rest = text[begin:].partition("gains = ")
                for score, value in scores(scenario, name, pace, dict(entry)).items():
                    head = head.replace(f"{score} = {entry[score]!r}", f"{score} = {value!r}")
                text = text[:begin] + head + gains + rest
    write_text_atomic(TABLE, text)


if __name__ == "__main__":
    tyro.cli(main)
