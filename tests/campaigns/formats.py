"""The files that the package reads, a small good one of each, and how each is read."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pter_gym.benchmark import run_scenario
from pter_gym.benchmark._results import Contents, ResultsFolder
from pter_gym.benchmark._run_files import HASH, file_hash, run_path, write_run
from pter_gym.benchmark._verification import compare_summary
from pter_gym.benchmark.episodes import CHECKSUMS, load_episodes, store_episodes
from pter_gym.benchmark.tuned import TABLE, find_tuned
from pter_gym.controllers import Free
from pter_gym.hands import read_forces
from pter_gym.params._preset import load_preset
from pter_gym.paths import read_path
from pter_gym.policies import SHIPPED, read_policy

from .corruption import Inside, in_gzip, in_header

ROOT = Path(__file__).parents[2]

POLICY = "residual"
SCENARIO = "everything"
EPISODES = 6

Seal = Callable[[bytes], None]


@dataclass(frozen=True)
class Format:
    """Files of a kind.

    Attributes
    ----------
    name
        What they are called.
    file
        One of them, which is read, and is good before it is damaged.
    read
        Reads it; what is wrong with it is raised.
    insides
        What can be damaged in it besides its bytes.
    seal
        Changes what vouches for it so that it fits; nothing does by default.
    prepare
        What has to be made again before each reading.
    """

    name: str
    file: Path
    read: Callable[[], object]
    insides: tuple[Inside, ...] = ()
    seal: Seal = lambda _: None
    prepare: Callable[[], object] = lambda: None


class LeftOut(Exception):
    """A file of results is left out, as it should be, with its reason."""


def formats(folder: Path) -> list[Format]:
    """Write a good file of each kind into a folder and say how they are read."""
    found = [*_policies(folder), *_settings(folder), *_episodes(folder), *_columns(folder), *_results(folder)]
    return [*found, *_runs(folder)] if find_spec("stable_baselines3") else found


def _copied(source: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / source.name).write_bytes(source.read_bytes())
    return folder / source.name


def _policies(folder: Path) -> list[Format]:
    place = folder / "policies"
    card, weights = (_copied(SHIPPED / f"{POLICY}{ending}", place) for ending in (".json", ".safetensors"))
    good = json.loads(card.read_bytes())

    def seal(data: bytes) -> None:
        card.write_text(json.dumps({**good, "weights_sha256": hashlib.sha256(data).hexdigest()}))

    def read() -> object:
        return read_policy(POLICY, place)

    return [Format("card", card, read), Format("safetensors", weights, read, (in_header,), seal)]


def _settings(folder: Path) -> list[Format]:
    preset, gains = (_copied(TABLE.parent / name, folder) for name in ("pter.toml", TABLE.name))
    tuned = [("impedance-tuned", "standard"), ("torque-feedback-tuned", SCENARIO), ("velocity-ratio-tuned", None)]
    return [
        Format("preset", preset, lambda: load_preset(preset)),
        Format("gains", gains, lambda: [find_tuned(*which, path=gains) for which in tuned]),
    ]


def _episodes(folder: Path) -> list[Format]:
    place = folder / "episodes"
    few = load_episodes(SCENARIO, "slow").first(EPISODES)
    packed = store_episodes(SCENARIO, few.machines, few.tasks, few.seeds, few.strata, version=0, folder=place)

    def read() -> object:
        return load_episodes(SCENARIO, "slow", folder=place)

    def seal(data: bytes) -> None:
        (place / CHECKSUMS).write_text(json.dumps({SCENARIO: hashlib.sha256(data).hexdigest()}))

    return [Format("episodes", packed, read, (in_gzip,), seal), Format("checksums", place / CHECKSUMS, read)]


def _columns(folder: Path) -> list[Format]:
    path, forces = (folder / name for name in ("path.csv", "forces.csv"))
    path.write_text("x,y\n-0.5,0.7\n-0.2,0.6\n0.1,0.8\n0.3,0.6\n")
    rows = [f"{0.01 * k:g},{40 + k % 3},{5.0 * np.sin(k):.4f}" for k in range(200)]
    forces.write_text("\n".join(["time,along,across", *rows]) + "\n")
    return [
        Format("path (CSV)", path, lambda: read_path(path).length),
        Format("forces (CSV)", forces, lambda: read_forces(forces).sampled(0.01)),
    ]


def _results(folder: Path) -> list[Format]:
    results = ResultsFolder(folder / "results")
    results.make()
    (run,) = run_scenario("standard", {"free": Free()}, ["brisk"], episodes=EPISODES)
    write_run(results.path, run)
    file = run_path(results.path, run.conditions)
    results.summarise()

    def read() -> Contents:
        contents = results.read()
        if contents.left_out:
            raise LeftOut(contents.left_out[0].reason)
        return contents

    def seal(data: bytes) -> None:
        """Hash what is in the file again, as somebody would who has edited it."""
        try:
            content = json.loads(data)
            file.write_text(json.dumps({**content, HASH: file_hash(content, file.name)}))
        except (ValueError, TypeError, RecursionError):
            file.write_bytes(data)

    contents = results.read()
    summary = Format("summary", results.summary, lambda: _told(compare_summary(results, contents)))
    return [Format("results", file, read, (), seal), summary]


def _told(finding: str) -> None:
    if finding != "same":
        raise LeftOut(finding)


def _runs(folder: Path) -> list[Format]:
    """Return the files of a training run; its model is made again for each reading, as a resume does."""
    from pter_agents.algorithms import load_settings, smoke_settings
    from pter_agents.checkpoints import load_checkpoint, save_checkpoint
    from pter_agents.training import PROGRESS, RUN, Arguments, RunFolder, make_draws, make_model, make_training_worlds

    interface = read_policy("ppo-standard").card.interface
    small = {"worlds": 8, "steps": 8, "contexts": 4, "minibatch": 32, "epochs": 1, "hidden": (8,), "value_hidden": (8,)}
    settings = smoke_settings("ppo", load_settings("ppo"), **small, privileged=False)
    arguments = Arguments(algorithm="ppo", scenario="standard", pace="brisk", steps=64, seed=3, settings=settings)
    place, config = folder / "run", folder / "config.toml"
    place.mkdir()
    run = RunFolder(place)
    run.begin(arguments, interface)
    config.write_text('learning_rate = 1e-3\nhidden = [8, 8]\nstarts = "path"\nnormalised = true\ndelay = 1\n')
    names = ("path_error_m", "completed", "mean_pace_error", "segment_pace_error", "peak_acceleration_m_s2")
    rows = {str(64 * k): {pace: dict.fromkeys(names, 0.25) for pace in ("slow", "brisk")} for k in range(1, 5)}
    (place / PROGRESS).write_text(json.dumps(rows, indent=1) + "\n")
    worlds = make_training_worlds(arguments, make_draws(arguments), interface)
    models: list[Any] = [make_model(arguments, worlds)]
    models[0].advance()
    checkpoint = save_checkpoint(models[0], place)

    def fresh() -> None:
        models.pop().close()
        models.append(make_model(arguments, worlds))

    return [
        Format("run", place / RUN, run.read),
        Format("progress", place / PROGRESS, run.scores),
        Format("training settings", config, lambda: load_settings("ppo", config)),
        Format("checkpoint", checkpoint, lambda: load_checkpoint(models[0], checkpoint), prepare=fresh),
    ]
