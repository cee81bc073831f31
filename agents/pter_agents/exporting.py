"""Export a run as a folder for the Hugging Face Hub: a policy's weights and its model card."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pter_agents.runs import RunFolder, policy_of
from pter_agents.settings import NO_BASE, TrainingArguments, load_settings
from pter_gym import __version__
from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.terminal import make_folder
from pter_gym.errors import ParameterError
from pter_gym.policies import TrainedPolicy, read_policy, write_policy
from pter_gym.policies._files import ENDING, RUN, check_name
from pter_gym.scenarios import PACES, SCENARIOS

README = "README.md"
"""Name of the model card."""


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
        If the run or the policy cannot be read.
    StorageError
        If the files cannot be written.
    """
    run = find_path("source", source)
    policy = read_run(run) if (run / RUN).is_file() else read_policy(source)
    name = name or policy.name
    check_name(name)
    out = Path(name) if out is None else find_path("out", out)
    make_folder(out)
    file = f"{name}{ENDING}"
    if others := sorted(path.name for path in out.iterdir() if path.name not in (README, file)):
        raise ParameterError(
            f"out must be a folder for this policy alone, {str(out)!r} holds "
            f"{', '.join(others):.200}"
        )
    write_text_atomic(out / README, model_card(name, policy))
    return write_policy(policy, out / file)


def read_run(path: FilePath) -> TrainedPolicy:
    """Return the policy of a run's newest checkpoint; raises as ``export``."""
    folder = RunFolder(path)
    arguments, interface = folder.read()
    steps, state = folder.load()
    about = about_run(arguments, steps, folder.scores().get(steps, {}))
    return policy_of(interface, state, arguments.algorithm, about)


def about_run(
    arguments: TrainingArguments, steps: int, scores: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what a card says about the training."""
    settings, usual = asdict(arguments.settings), asdict(load_settings(arguments.algorithm))
    changed = {name: value for name, value in settings.items() if value != usual[name]}
    options = {name: getattr(arguments, name) for name in ("scenario", "pace", "steps", "seed")}
    options |= ({"config": "FILE"} if changed else {}) | (
        {"machine": "FILE"} if arguments.machine else {}
    )
    command = " ".join(
        (
            "pter train",
            arguments.algorithm,
            *(f"--{name} {value}" for name, value in options.items()),
        )
    )
    scenario = SCENARIOS.get(arguments.scenario)
    return {
        "algorithm": arguments.algorithm,
        "corrects": None if arguments.settings.base == NO_BASE else arguments.settings.base,
        "scenario": scenario.id if scenario else arguments.scenario,
        "pace": arguments.pace,
        "command": command,
        "config": changed,
        "settings": settings,
        "steps": steps,
        "seed": arguments.seed,
        "versions": {"pter-gym": __version__, **{each: version(each) for each in ("numpy", "jax")}},
        "validation": dict(scores),
    }


def model_card(name: str, policy: TrainedPolicy) -> str:
    """Return the model card in Markdown, with metadata for the Hub."""
    about, interface = policy.about, policy.interface
    *hidden, outputs = policy.sizes[1:]
    what = (
        f"corrects the controller `{about['corrects']}`"
        if about.get("corrects")
        else "sets the clutch voltages"
    )
    meaning = f"of ±1 is ±{interface.reach:g} V, limited to 0…{interface.voltage_max:g} V"
    if interface.normalised:
        meaning = f"a within ±1 is {interface.voltage_max:g} V · ((a + 1)/2)²"
    versions = ", ".join(f"{key} {number}" for key, number in about.get("versions", {}).items())
    units = ", ".join(map(str, hidden))
    skip = f"frame_skip={interface.frame_skip}"
    lines = [
        "---",
        "license: mit",
        "library_name: pter-gym",
        "pipeline_tag: reinforcement-learning",
        "tags: [reinforcement-learning, robotics, haptics, gymnasium, pter-gym]",
        "---",
        "",
        f"# {name}",
        "",
        f"A policy for the passive haptic arm PTER that {what}.",
        "",
        f"- Trained by `{about.get('algorithm')}` on training draws of `{about.get('scenario')}`",
        f"- Command: `{about.get('command')}` ({about.get('steps')} decisions)",
        *(
            f"- In the file: `{key} = {json.dumps(value)}`"
            for key, value in about.get("config", {}).items()
        ),
        f"- Versions: {versions}",
        f"- Network: {policy.sizes[0]} inputs, tanh layers of {units}, {outputs} outputs",
        f"- An output {meaning}",
        f"- Inputs: {', '.join(each.name for each in interface.inputs)}",
        "",
        "It is made for the simulator: clutches, sensors and hand of a real machine are others.",
        "",
        *_score_table(about.get("validation", {})),
        "```python",
        "import gymnasium",
        "import pter_gym",
        "",
        f'env = gymnasium.make("PTER/Standard-v0", pace="medium", {skip})',
        'policy = pter_gym.load_policy("path/to/this/folder", env)',
        "observation, info = env.reset(seed=0)",
        "policy.reset()",
        "action = policy(observation)",
        "```",
        "",
        "`pter benchmark --policies path/to/this/folder` scores it.",
    ]
    return "\n".join(lines) + "\n"


def _score_table(validation: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return the scores of the validation as lines of Markdown."""
    if not validation:
        return []
    return [
        "Scores on drawn validation episodes, which are neither trained on nor the benchmark's:",
        "",
        "| pace | path error [mm] | completed [%] | mean pace error [%] | segment pace error [%] |",
        "|---|---|---|---|---|",
        *(
            f"| {pace} ({PACES[pace]:g} m/s) | {1000 * s['path_error_m']:.1f} "
            f"| {100 * s['completed']:.1f} | "
            f"{100 * s['mean_pace_error']:.1f} | {100 * s['segment_pace_error']:.1f} |"
            for pace, s in validation.items()
        ),
        "",
    ]
