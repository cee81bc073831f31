"""The report: one HTML file to be read from top to bottom, with all pictures embedded."""

import base64
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup, escape

from pter_gym._version import __version__
from pter_gym.tools.paper.experiments.claims import Claim, Kind
from pter_gym.tools.paper.experiments.setup import Setup
from pter_gym.tools.paper.reproduce.chapters import CHAPTERS

SIGNS: dict[Kind, str] = {"prediction": "✓", "calibration": "≈", "construction": "=", "not met": "✗"}
MEANINGS: dict[Kind, str] = {
    "prediction": "it holds, nothing was fitted to it, and other machines could fail it",
    "calibration": "it holds because numbers were fitted to it, so it is no evidence",
    "construction": "it follows from the equations or from values put into the model, so every machine would meet it",
    "not met": "it does not hold in our simulation",
}


class Parameter(NamedTuple):
    """A row of the table of parameters."""

    name: str
    value: str
    unit: str
    provenance: str


def report(setup: Setup, claims: Sequence[Claim], pictures: Mapping[str, bytes]) -> str:
    """Return the report as HTML.

    Parameters
    ----------
    setup
        Setup of the experiments.
    claims
        All checked claims.
    pictures
        Content of the PNG files by name without extension.
    """
    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    pages.filters["prose"] = prose
    return pages.get_template("report.html").render(
        version=__version__,
        signs=SIGNS,
        meanings=MEANINGS,
        counts=Counter(claim.kind for claim in claims),
        chapters=CHAPTERS,
        claims=claims,
        pictures={name: base64.b64encode(content).decode() for name, content in pictures.items()},
        parameters=parameters(setup),
    )


def prose(text: str) -> Markup:
    """Return text as HTML, with subscripts for ``T_s`` and ``T_k``."""
    html = str(escape(text)).replace("T_s", "<i>T</i><sub>s</sub>").replace("T_k", "<i>T</i><sub>k</sub>")
    return Markup(html)


def parameters(setup: Setup) -> dict[str, list[Parameter]]:
    """Return the parameters of a setup by part."""
    parts = {name.replace("_", " "): machine for name, machine in setup.machines.items()}
    parts |= {"the task": setup.task, "the controller": setup.controller}
    choices = [
        _parameter(item.name, getattr(setup, item.name), item.metadata)
        for item in fields(setup)
        if item.name not in ("machines", "task", "controller")
    ]
    return {"the experiments": choices, **{name: list(_leaves("", part)) for name, part in parts.items()}}


def _leaves(prefix: str, part: Any) -> Iterator[Parameter]:
    for item in fields(part):
        value = getattr(part, item.name)
        name = f"{prefix}{item.name}"
        if is_dataclass(value):
            yield from _leaves(f"{name}.", value)
        else:
            yield _parameter(name, value, item.metadata)


def _parameter(name: str, value: Any, metadata: Mapping[str, str]) -> Parameter:
    if isinstance(value, bool | str):
        text = str(value)
    elif isinstance(value, tuple):
        text = ", ".join(getattr(each, "name", None) or f"{each:.4g}" for each in cast("tuple[Any, ...]", value))
    else:
        text = f"{value:.5g}"
    return Parameter(name, text, "" if metadata["unit"] == "1" else metadata["unit"], metadata["provenance"])
