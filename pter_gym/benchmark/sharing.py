"""A policy as a folder in the layout of the Hugging Face hub: its files, a model card with scores, and a film.

Nothing here uses a network. The folder is read like that of any exported policy.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from pter_gym._version import __version__
from pter_gym.benchmark.evaluation import fresh_seed, run_scenario
from pter_gym.benchmark.leaderboard import Leaderboard, leaderboards
from pter_gym.benchmark.simulation import record_episode, time_limit
from pter_gym.internal.checks import whole_number
from pter_gym.internal.files import FilePath, find_path, write_files_atomic
from pter_gym.internal.terminal import make_folder
from pter_gym.policies import SHIPPED, Neural, load_policy, shipped_policies
from pter_gym.policies.files import CARD, TEXT, WEIGHTS, find_exported
from pter_gym.scenarios import PACES, SCENARIOS, Scenario

EPISODES = 200
"""Fresh episodes at each pace from which the scores come."""

README, FILM = "README.md", "replay.mp4"
"""Names that the hub looks for: the model card, and the film on its page."""

FILM_PACE, FILM_SEED = "medium", 0
"""Of the episode in the film, a training draw."""

LICENCE = "mit"


class Metric(NamedTuple):
    """A score on a card.

    Attributes
    ----------
    score
        Its name in ``Score``.
    factor, unit
        From SI to what is shown.
    digits
        Behind the point.
    """

    score: str
    factor: float
    unit: str
    digits: int


METRICS = (Metric("path_error_m", 1000.0, "mm", 2), Metric("completed", 100.0, "%", 1))


def share_policy(policy: FilePath, out: FilePath, *, episodes: int = EPISODES) -> Path:
    """Write a trained policy as a folder for the hub, and return the folder.

    Parameters
    ----------
    policy
        Name of one that the package ships, or path of an exported one.
    out
        The folder; made if need be.
    episodes
        Fresh episodes at each pace, at least 1. Their seed follows from the content of the policy.

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
    _check_film()
    name, source = _find(policy)
    neural = load_policy(name, source)
    scenario = scenario_of(neural.card.about.get("scenario"))
    make_folder(where)
    told = {name: neural}
    runs = run_scenario(scenario.name, told, episodes=episodes, fresh=fresh_seed(scenario.name, told))
    boards = leaderboards(runs)
    text = (source / f"{name}{TEXT}").read_text("utf-8") if (source / f"{name}{TEXT}").is_file() else f"# {name}\n"
    parts = {f"{name}{ending}": (source / f"{name}{ending}").read_bytes() for ending in (WEIGHTS, CARD)}
    film = film_of(name, neural, scenario)
    card = f"{front_matter(name, scenario, boards)}\n{model_card(text, scenario, boards)}"
    write_files_atomic(where, {**parts, FILM: film, README: card.encode()})
    return where


def _find(policy: FilePath) -> tuple[str, Path]:
    """Return name and folder of a policy."""
    if policy in shipped_policies():
        return str(policy), SHIPPED
    return find_exported(policy)


def scenario_of(trained_on: Any) -> Scenario:
    """Return the scenario on which a policy is scored: that of its training, or ``everything``."""
    found = [each for each in SCENARIOS.values() if trained_on in (each.id, each.name)]
    return found[0] if found else SCENARIOS["everything"]


def front_matter(name: str, scenario: Scenario, boards: Sequence[Leaderboard]) -> str:
    """Return what the hub reads of a card, in YAML, of which JSON is a part."""
    metrics = [
        {
            "type": metric.score,
            "name": f"{metric.score} at {board.pace} pace [{metric.unit}]",
            "value": _shown(board, metric)[0],
            "args": {
                "pace_m_s": PACES[board.pace],
                "interval_95": _shown(board, metric)[1:],
                "episodes": board.episodes,
                "fresh_seed": str(board.fresh),
            },
        }
        for board in boards
        for metric in METRICS
    ]
    task = "reinforcement-learning"
    return "\n".join(
        [
            "---",
            f"license: {LICENCE}",
            "library_name: pter-gym",
            f"pipeline_tag: {task}",
            f"tags: [{task}, robotics, haptics, gymnasium, pter-gym, {scenario.id}]",
            "model-index:",
            f"- name: {json.dumps(name)}",
            "  results:",
            f"  - task: {{type: {task}, name: {task}}}",
            f"    dataset: {{type: {scenario.id}, name: {scenario.id}}}",
            "    metrics:",
            *(f"    - {json.dumps(metric)}" for metric in metrics),
            "---",
            "",
        ]
    )


def model_card(text: str, scenario: Scenario, boards: Sequence[Leaderboard]) -> str:
    """Return what people read of a card: what was written at the export, the scores, and how to use the policy."""
    rows = [
        f"| {board.pace} ({PACES[board.pace]:g} m/s) | "
        + " | ".join("{} ({} … {})".format(*_shown(board, metric)) for metric in METRICS)
        + " |"
        for board in boards
    ]
    first = boards[0]
    return "\n".join(
        [
            text.rstrip(),
            "",
            "## Scores",
            "",
            f"On {first.episodes} fresh episodes of `{scenario.name}` at each pace by pter-gym {__version__}.",
            f"Their seed, {first.fresh}, follows from the content of the policy. In brackets intervals of 95 %.",
            "",
            "| pace | path error [mm] | at the end [%] |",
            "|---|---|---|",
            *rows,
            "",
            "## Use",
            "",
            "```python",
            "import gymnasium",
            "import pter_gym",
            "",
            f'env = gymnasium.make("{scenario.id}", pace="medium")',
            'policy = pter_gym.load_policy("path/to/this/folder", env)',
            "observation, info = env.reset(seed=0)",
            "action = policy(observation)",
            "```",
            "",
            f"`pter benchmark --scenario {scenario.name} --policies path/to/this/folder` scores it.",
            "",
        ]
    )


def _shown(board: Leaderboard, metric: Metric) -> tuple[float, float, float]:
    """Return a score with its interval as it is shown."""
    found = board.standings[0].scores[metric.score]
    value, low, high = (round(metric.factor * each, metric.digits) for each in found)
    return value, low, high


def _check_film() -> None:
    from pter_gym.render.canvas import load_pygame
    from pter_gym.render.recording import check_ending

    load_pygame()
    check_ending(Path(FILM))


def film_of(name: str, policy: Neural, scenario: Scenario) -> bytes:
    """Return a film of one training draw."""
    from pter_gym.render.film import Film, Shot
    from pter_gym.render.picture import Subject
    from pter_gym.render.recording import RATES, write_film

    ((machine, task),) = scenario.randomisation(FILM_PACE, contexts=1, seed=FILM_SEED).pairs()
    episode = record_episode(policy, machine, task, FILM_SEED, time_limit(task))
    film = Film([Shot(Subject(machine, task, name), episode.telemetry)], RATES[Path(FILM).suffix])
    with TemporaryDirectory() as folder:
        write_film(film, Path(folder) / FILM)
        return (Path(folder) / FILM).read_bytes()
