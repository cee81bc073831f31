"""A policy as a folder in the layout of the Hugging Face Hub: its files, a model card with scores, and a video.

Nothing here accesses the network. The folder is read like that of any exported policy.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, find_path, write_files_atomic
from pter_gym._internal.plugins import load_artist
from pter_gym._internal.terminal import make_folder
from pter_gym._version import __version__
from pter_gym.benchmark import run_scenario
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.simulation import record_episode, time_limit
from pter_gym.policies import SHIPPED, Neural, read_policy, shipped_policies
from pter_gym.policies._files import CARD, TEXT, WEIGHTS, find_exported
from pter_gym.scenarios import PACES, SCENARIOS, Scenario

EPISODES = 200
"""Fresh episodes at each pace from which the scores come."""

README, FILM = "README.md", "replay.mp4"
"""Names that the hub looks for: the model card, and the film on its page."""

SHOWN = (("path_error_m", "mm", 1000.0, 2), ("completed", "%", 100.0, 1))
"""The scores on a card: name, unit, factor from SI to it, and decimals."""

CARD_TEXT = Template("""\
---
license: mit
library_name: pter-gym
pipeline_tag: reinforcement-learning
tags: [reinforcement-learning, robotics, haptics, gymnasium, pter-gym, $id]
model-index: $index
---

$text

## Scores

On $episodes fresh episodes of `$scenario` at each pace by pter-gym $version.
Their seed follows from the content of the policy. In brackets intervals of 95 %.

| pace | path error [mm] | at the end [%] |
|---|---|---|
$rows

## Use

```python
import gymnasium
import pter_gym

env = gymnasium.make("$id", pace="medium", frame_skip=$frame_skip)
policy = pter_gym.load_policy("path/to/this/folder", env)
observation, info = env.reset(seed=0)
action = policy(observation)
```

`pter benchmark --scenario $scenario --policies path/to/this/folder --seed 1` scores it.
""")
"""What the hub reads of a card, in YAML, of which JSON is a part, and what people read."""

FRESH_SEED = 1
"""Seed of the fresh episodes on which policies are scored."""


def share_policy(policy: FilePath, out: FilePath, *, episodes: int = EPISODES) -> Path:
    """Write a trained policy as a folder for the Hub, and return the folder.

    Parameters
    ----------
    policy
        Name of a shipped policy, or path of an exported one.
    out
        The folder; created if needed.
    episodes
        Fresh episodes at each pace, at least 1.

    Raises
    ------
    ParameterError
        If there is no such policy, or a number is out of range.
    DependencyError
        If the extra ``render`` is missing.
    StorageError
        If the folder cannot be written.
    """
    episodes, where = whole_number("episodes", episodes), find_path("out", out)
    load_artist("film").check_suffix(Path(FILM))
    name, source = (str(policy), SHIPPED) if policy in shipped_policies() else find_exported(policy)
    neural = read_policy(name, source)
    scenario = scenario_of(neural.card.about.get("scenario"))
    make_folder(where)
    told = {name: neural}
    runs = run_scenario(scenario.name, told, episodes=episodes, seed=FRESH_SEED)
    written = source / f"{name}{TEXT}"
    text = written.read_text("utf-8") if written.is_file() else f"# {name}\n"
    parts = {f"{name}{ending}": (source / f"{name}{ending}").read_bytes() for ending in (WEIGHTS, CARD)}
    parts[FILM] = _film(name, neural, scenario)
    parts[README] = model_card(name, text, scenario, leaderboards(runs), neural.card.interface.frame_skip).encode()
    write_files_atomic(where, parts)
    return where


def scenario_of(trained_on: Any) -> Scenario:
    """Return the scenario on which a policy is scored: the one it was trained on, or ``everything``."""
    found = [each for each in SCENARIOS.values() if trained_on in (each.id, each.name)]
    return found[0] if found else SCENARIOS["everything"]


def model_card(name: str, text: str, scenario: Scenario, boards: Sequence[Leaderboard], frame_skip: int = 1) -> str:
    """Return a policy's card: metadata for the Hub, the exported model card, the scores, and how to use it."""
    metrics: list[dict[str, Any]] = []
    rows: list[str] = []
    for board in boards:
        cells = [f"{board.pace} ({PACES[board.pace]:g} m/s)"]
        for score, unit, factor, digits in SHOWN:
            value, low, high = (round(factor * each, digits) for each in board.standings[0].scores[score])
            cells.append(f"{value} ({low} … {high})")
            told = {"pace_m_s": PACES[board.pace], "interval_95": [low, high], "seed": board.seed}
            metrics.append(
                {
                    "type": score,
                    "name": f"{score} at {board.pace} pace [{unit}]",
                    "value": value,
                    "args": {**told, "episodes": board.episodes},
                }
            )
        rows.append(f"| {' | '.join(cells)} |")
    task = {"type": "reinforcement-learning", "name": "reinforcement-learning"}
    result = {"task": task, "dataset": {"type": scenario.id, "name": scenario.id}, "metrics": metrics}
    return CARD_TEXT.substitute(
        id=scenario.id,
        frame_skip=frame_skip,
        index=json.dumps([{"name": name, "results": [result]}]),
        text=text.rstrip(),
        episodes=boards[0].episodes,
        scenario=scenario.name,
        version=__version__,
        rows="\n".join(rows),
    )


def _film(name: str, policy: Neural, scenario: Scenario) -> bytes:
    """Return a video of one training draw at medium pace."""
    ((machine, task),) = scenario.randomisation("medium", contexts=1, seed=0).pairs()
    episode = record_episode(policy, machine, task, 0, time_limit(task))
    with TemporaryDirectory() as folder:
        load_artist("film").write_film(machine, task, {name: episode.telemetry}, Path(folder) / FILM)
        return (Path(folder) / FILM).read_bytes()
