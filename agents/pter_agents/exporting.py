"""Export a run as a policy: weights without code, a card, and a model card in Markdown."""

import json
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from pter_agents.algorithms import Model, load_settings, smoke_settings
from pter_agents.checkpoints import load_checkpoint, steps_of
from pter_agents.networks import Actor
from pter_agents.settings import PLAIN
from pter_agents.training import Arguments, RunFolder, make_draws, make_model, make_training_worlds
from pter_agents.worlds import ALL, TrainingWorlds
from pter_gym import __version__
from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.terminal import make_folder
from pter_gym.benchmark import PACES
from pter_gym.errors import DataError
from pter_gym.params import Machine
from pter_gym.policies import Card, read_policy, write_policy
from pter_gym.policies._cards import fields_of
from pter_gym.policies._files import check_name
from pter_gym.scenarios import find_scenario

SAME = 1e-6
"""Largest difference between a run's policy and the exported one, relative to the largest voltage."""

TRIES = 100
"""Control steps over which both are compared, each in all worlds."""

Tensors = dict[str, NDArray[np.float32]]


def export_run(run: FilePath, out: FilePath, *, name: str | None = None) -> tuple[Path, float]:
    """Write the newest checkpoint of a run as a policy; return its card's path and the largest difference.

    Parameters
    ----------
    run
        Folder of the run.
    out
        Folder for the policy; created if needed.
    name
        Name of the policy; by default, the algorithm's.

    Raises
    ------
    ParameterError
        If there is no run with a checkpoint, or a policy cannot have this name.
    DataError
        If the run cannot be read, or the two policies act differently.
    StorageError
        If the policy cannot be written.
    """
    folder, out = RunFolder(run), find_path("out", out)
    arguments, interface = folder.read()
    name = arguments.algorithm if name is None else name
    check_name(name)
    make_folder(out)
    settings = arguments.settings
    few = replace(arguments, settings=smoke_settings(arguments.algorithm, settings, contexts=settings.contexts))
    worlds = make_training_worlds(few, make_draws(few), interface)
    model = make_model(few, worlds)
    try:
        steps = load_newest(model, folder)
        actor = model.actor()
        card = Card(
            name=name,
            observation=fields_of(worlds.env.observation_layout),
            voltage_max=worlds.interface.voltage_max,
            interface=interface,
            hidden=settings.hidden,
            weights_sha256="",
            about=about_run(arguments, folder, steps),
            squashed=actor.squashed,
            lstm=actor.units,
            clutches=tuple(each.row for each in arguments.nominal.clutches),
        )
        files = card, tensors_of(actor), model_card(card)
        with TemporaryDirectory() as trial:
            write_policy(*files, Path(trial))
            difference = compare(actor.exact(), worlds, arguments.nominal, name, Path(trial))
    finally:
        model.close()
        worlds.close()
    if not difference <= SAME:
        raise DataError(f"the exported policy differs from the run's by {difference:.1e} of the largest voltage")
    return write_policy(*files, out), difference


def load_newest(model: Model, folder: RunFolder) -> int:
    """Load the networks of the newest checkpoint of a run, which may still be training, and return its control steps.

    Raises
    ------
    DataError
        If the run has no checkpoint, or it cannot be read.
    """
    while True:
        newest = folder.newest()
        if newest is None:
            raise DataError(f"there is no checkpoint in {folder.path}")
        try:
            load_checkpoint(model, newest, weights_only=True)
        except DataError:
            if newest.exists():
                raise
        else:
            return steps_of(newest)


def tensors_of(actor: Actor) -> Tensors:
    """Return the weights of a policy by their names in its file."""
    found: dict[str, torch.Tensor] = {}
    for k, layer in enumerate(layer for layer in actor.layers if isinstance(layer, nn.Linear)):
        found[f"layer_{k}.weight"] = layer.weight
        found[f"layer_{k}.bias"] = layer.bias
    if actor.lstm is not None:
        ((inputs, hidden, bias, another),) = actor.lstm.all_weights
        found |= {"lstm.weight_inputs": inputs, "lstm.weight_hidden": hidden, "lstm.bias": bias + another}
    return {name: tensor.detach().numpy().astype(np.float32) for name, tensor in found.items()}


def compare(actor: Actor, worlds: TrainingWorlds, nominal: Machine, name: str, folder: Path) -> float:
    """Return the largest difference between the voltages of a run and a policy, relative to the largest voltage."""
    layout = worlds.env.observation_layout
    policy = read_policy(name, folder).bind(nominal, layout)
    obs: Any = worlds.env.reset(seed=0)[0]  # worlds that end begin again and are not forgotten, for both policies alike
    past, memory = worlds.interface.begin(worlds.count), actor.begin(worlds.count)
    largest = 0.0
    for _ in range(TRIES):
        inputs, base = worlds.interface.see(obs, past)
        outputs, memory = actor(inputs, memory)
        theirs = worlds.interface.volts(base, outputs)
        mine = policy(obs)
        largest = max(largest, float(np.abs(mine - theirs).max()))
        obs = worlds.env.step(mine)[0]
    return largest / nominal.clutch.voltage_max


def about_run(arguments: Arguments, folder: RunFolder, steps: int) -> dict[str, Any]:
    """Return what a card says about the training."""
    settings = arguments.settings
    usual = load_settings(arguments.algorithm)
    changed = {name: value for name, value in vars(settings).items() if value != getattr(usual, name)}
    options = {name: getattr(arguments, name) for name in ("scenario", "pace", "steps", "seed")}
    options |= ({"config": "FILE"} if changed else {}) | ({"machine": "FILE"} if arguments.machine else {})
    told = {name: value for name, value in arguments.as_json().items() if name != "settings" and value is not None}
    return {
        "algorithm": arguments.algorithm,
        "corrects": None if settings.base == PLAIN else settings.base,
        "scenario": ALL if arguments.scenario == ALL else find_scenario(arguments.scenario).id,
        "pace": arguments.pace,
        "command": " ".join(
            [f"pter train {arguments.algorithm}", *(f"--{name} {value}" for name, value in options.items())]
        ),
        "arguments": told,
        "config": changed,
        "settings": vars(settings),
        "steps": steps,
        "seed": arguments.seed,
        "versions": {"pter-gym": __version__, **{package: version(package) for package in ("numpy", "torch")}},
        "validation": folder.scores().get(steps, {}),
    }


def model_card(card: Card) -> str:
    """Return the model card in Markdown."""
    about, interface = card.about, card.interface
    what = f"corrects the controller `{about['corrects']}`" if about["corrects"] else "sets the clutch voltages"
    drawn = "all scenarios" if about["scenario"] == ALL else f"`{about['scenario']}`"
    lstm = f"an LSTM of {card.lstm}, " if card.lstm else ""
    outputs = "4 outputs behind tanh" if card.squashed else "4 outputs"
    meaning = f"of ±1 is ±{interface.reach:g} V, limited to 0…{card.voltage_max:g} V"
    if interface.normalised:
        meaning = f"a within ±1 is {card.voltage_max:g} V · ((a + 1)/2)²"
    lines = [
        f"# {card.name}",
        "",
        f"A policy that {what}, trained by `{about['algorithm']}` on the training draws of {drawn}.",
        "",
        f"- Command: `{about['command']}` ({about['steps']} control steps)",
        *(f"- In the file: `{name} = {json.dumps(value)}`" for name, value in about["config"].items()),
        f"- Versions: {', '.join(f'{name} {number}' for name, number in about['versions'].items())}",
        f"- Network: {interface.size} inputs, {lstm}tanh layers of {', '.join(map(str, card.hidden))}, {outputs}",
        f"- An output {meaning}",
        f"- Observations: {', '.join(name for name, _, _ in card.observation)}",
        "",
        "It is made for the simulator. On a real machine its clutches, sensors and hand differ from what it has seen.",
        "",
    ]
    validation: dict[str, dict[str, float]] = about["validation"]
    if validation:
        lines += [
            "Scores on drawn validation episodes, which are neither trained on nor the benchmark's:",
            "",
            "| pace | path error [mm] | at the end [%] | mean pace error [%] | segment pace error [%] |",
            "|---|---|---|---|---|",
            *(
                f"| {pace} ({PACES[pace]:g} m/s) | {1000 * s['path_error_m']:.1f} | {100 * s['completed']:.1f} | "
                f"{100 * s['mean_pace_error']:.1f} | {100 * s['segment_pace_error']:.1f} |"
                for pace, s in validation.items()
            ),
            "",
        ]
    return "\n".join(lines)
