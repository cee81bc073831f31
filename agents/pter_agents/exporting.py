"""Export a run as a policy in a folder of its own, as the Hugging Face Hub has it."""

import html
import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from pter_agents.draws import PaceScores
from pter_agents.runs import RunFolder, policy_of
from pter_agents.settings import NO_BASE, TrainingArguments, load_settings
from pter_gym._internal.files import (
    FilePath,
    expand_path,
    make_folder,
    remove_leftovers,
    write_files_atomic,
)
from pter_gym.errors import DataError, ParameterError
from pter_gym.policies import TrainedController, read_policy
from pter_gym.policies._files import ENDING, RUN, check_name, encode_policy
from pter_gym.scenarios import PACES, SCENARIOS

README = "README.md"
"""Name of the model card."""

MAX_TEXT = 500
"""Characters of a text that the card repeats."""


def export(source: FilePath, out: FilePath | None = None, *, name: str | None = None) -> Path:
    """Write a policy and its model card to a folder, and return the policy's file.

    Parameters
    ----------
    source
        Folder of a run, whose newest checkpoint is exported, or a trained policy by its name or
        path.
    out
        Folder for the two files, which must hold nothing else; by default ``name`` in the current
        folder.
    name
        Name of the policy; by default, the algorithm's or the policy's own.

    Raises
    ------
    ParameterError
        If there is no such run or policy, it cannot have this name, or the folder holds other
        files.
    DataError
        If the run or the policy cannot be read, or what it tells of its training is not as
        ``about_run`` makes it.
    StorageError
        If the files cannot be written; older ones then stay.
    """
    run = expand_path("source", source)
    policy = read_newest(run) if (run / RUN).is_file() else read_policy(source)
    name = name or policy.name
    check_name(name)
    out = Path(name) if out is None else expand_path("out", out)
    make_folder(out)
    remove_leftovers(out)
    file = f"{name}{ENDING}"
    own = (README, file)
    if others := sorted(path.name for path in out.iterdir() if path.name not in own):
        raise ParameterError(
            f"out must be a folder for this policy alone, {str(out)!r} holds "
            f"{', '.join(others):.200}"
        )
    card = model_card(name, policy).encode()
    write_files_atomic(out, {file: encode_policy(policy), README: card})
    return out / file


def read_newest(path: FilePath) -> TrainedController:
    """Return the policy of a run's newest checkpoint; raises as ``export``."""
    folder = RunFolder(path)
    arguments, interface = folder.read()
    steps, state = folder.load()
    about = about_run(arguments, steps, folder.scores().get(steps, {}), folder.versions())
    return policy_of(interface, state, arguments.algorithm, about)


def about_run(
    arguments: TrainingArguments, steps: int, scores: PaceScores, versions: Mapping[str, str]
) -> dict[str, Any]:
    """Return what a card says about the training."""
    given = arguments.settings
    settings, usual = asdict(given), asdict(load_settings(arguments.algorithm, None, given.teacher))
    changed = {name: value for name, value in settings.items() if value != usual[name]}
    settings["teacher"] = Path(given.teacher).name
    options = {name: getattr(arguments, name) for name in ("scenario", "pace", "steps", "seed")}
    files = {
        "teacher": settings["teacher"],
        "config": "FILE" if changed else "",
        "machine": "FILE" if arguments.machine else "",
        "hand": "FILE" if arguments.hand else "",
    }
    options |= {name: file for name, file in files.items() if file}
    words = ("pter train", arguments.algorithm, *(f"--{name} {x}" for name, x in options.items()))
    scenario = SCENARIOS.get(arguments.scenario)
    return {
        "algorithm": arguments.algorithm,
        "corrects": None if arguments.settings.base == NO_BASE else arguments.settings.base,
        "scenario": scenario.id if scenario else arguments.scenario,
        "pace": arguments.pace,
        "command": " ".join(words),
        "config": changed,
        "settings": settings,
        "steps": steps,
        "seed": arguments.seed,
        "versions": dict(versions),
        "validation": dict(scores),
    }


def model_card(name: str, policy: TrainedController) -> str:
    """Return the model card in Markdown, with metadata for the Hub."""
    about, interface = policy.about, policy.interface
    *hidden, outputs = policy.sizes[1:]
    corrects = about.get("corrects")
    role = f"corrects the controller {code(corrects)}" if corrects else "sets the clutch voltages"
    meaning = f"of ±1 is ±{interface.reach:g} V, limited to 0…{interface.voltage_max:g} V"
    if interface.normalised:
        meaning = f"a within ±1 is {interface.voltage_max:g} V · ((a + 1)/2)²"
    versions = ", ".join(
        code(f"{key} {number}") for key, number in part_of(about, "versions").items()
    )
    changed = part_of(about, "config").items()
    layers = ", ".join(map(str, hidden))
    table = score_table(part_of(about, "validation"))
    listed = "".join(
        f"- In the file: {code(f'{key} = {json.dumps(value)}')}\n" for key, value in changed
    )
    return f"""\
---
license: mit
library_name: pter-gym
pipeline_tag: reinforcement-learning
tags: [reinforcement-learning, robotics, haptics, gymnasium, pter-gym]
---

# {name}

A policy for the passive haptic arm PTER that {role}.

- Trained by {code(about.get("algorithm"))} on draws of {code(about.get("scenario"))}
- Command: {code(about.get("command"))}, {code(about.get("steps"))} steps
{listed}- Versions: {versions}
- Network: {policy.sizes[0]} inputs, tanh layers of {layers}, {outputs} outputs
- An output {meaning}
- Inputs: {", ".join(each.name for each in interface.inputs)}

It is made for the simulator, from which a real machine, its sensors and its hand differ.

{table}```python
import gymnasium
import pter_gym

env = gymnasium.make("PTER/Standard-v0", frame_skip={interface.frame_skip})
policy = pter_gym.load_policy("path/to/this/folder", env)
observation, info = env.reset(seed=0)
policy.reset()
action = policy(observation)
```

`pter benchmark --policies path/to/this/folder` scores it.
"""


def code(text: Any) -> str:
    """Return a stranger's text as code in a line of Markdown, where nothing has a meaning."""
    plain = re.sub(r"[`\s\x00-\x1f\x7f-\x9f]+", " ", str(text)).strip()
    return f"`{html.escape(plain[:MAX_TEXT], quote=False)}`"


def part_of(about: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a part of a policy's record of its training, or raise a DataError."""
    found: Any = about.get(name, {})
    if not isinstance(found, dict):
        raise DataError(f"about: {name} must be a table, got {found!r:.200}")
    return cast(dict[str, Any], found)


def score_table(validation: Mapping[str, Any]) -> str:
    """Return the scores of the validation as a table of Markdown."""
    try:
        rows = "".join(
            f"| {pace} ({PACES[pace]:g} m/s) | {1000 * scores['path_error_m']:.1f} | "
            f"{100 * scores['completed']:.1f} | {100 * scores['mean_pace_error']:.1f} | "
            f"{100 * scores['segment_pace_error']:.1f} |\n"
            for pace, scores in validation.items()
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"about: validation must hold numbers by pace and score, got {error!r:.200}"
        ) from None
    return (
        rows
        and f"""\
Scores on drawn validation episodes, which are neither trained on nor the benchmark's:

| pace | path error [mm] | completed [%] | mean pace error [%] | segment pace error [%] |
|---|---|---|---|---|
{rows}
"""
    )
