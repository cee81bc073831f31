"""The report: one HTML file that a person reads from top to bottom, with every picture inside it."""

import base64
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from importlib.resources import files
from typing import Any, cast

from pter_gym._version import __version__
from pter_gym.paper.experiments.claims import Claim, Kind
from pter_gym.paper.experiments.setup import Setup
from pter_gym.paper.reproduce.figures import PRODUCTS

SIGNS: dict[Kind, str] = {"reproduced": "✓", "calibrated": "≈", "not met": "✗"}
MEANINGS: dict[Kind, str] = {
    "reproduced": "it holds in our simulation, and no number was fitted to it",
    "calibrated": "it holds, but a number was fitted to it or put into the model, so that it is no evidence",
    "not met": "it does not hold in our simulation",
}


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A chapter of the report: its title, what it is about, and the products that it shows."""

    title: str
    text: str
    products: tuple[str, ...]


CHAPTERS = (
    Chapter(
        title="The clutch model",
        text="A clutch sticks until the torque on it exceeds the breakaway torque T_s; then it slips and exerts the "
        "dynamic torque T_k. Both follow its voltage through a first-order lag. Four clutches act on two axes, so that "
        "two, one or no degrees of freedom are left to the arm.",
        products=("fig3", "fig4", "step"),
    ),
    Chapter(
        title="The friction materials",
        text="Three materials are compared: the clutches as they are, Delrin as measured on a testbed, and Delrin as "
        "the literature has it, with a higher dynamic than static friction.",
        products=("fig5",),
    ),
    Chapter(
        title="The standard test",
        text="The tip is pushed along a straight path by a constant force, while five sines disturb it across the "
        "path. An impedance controller asks for forces that passive clutches can only approach.",
        products=("fig7", "fig8", "table1", "fig9"),
    ),
    Chapter(
        title="Torque feedback",
        text="Each clutch gets a proportional loop on the difference of the wanted and the generated torque, which "
        "corrects the controller's rough torque table.",
        products=("fig10", "fig11"),
    ),
)


def report(setup: Setup, claims: Sequence[Claim], pictures: Mapping[str, bytes]) -> str:
    """Return the report as HTML.

    Parameters
    ----------
    setup
        What the experiments ran on.
    claims
        All checked claims.
    pictures
        Content of the PNG files by their names without the ending.
    """
    style = files("pter_gym.paper.reproduce").joinpath("report.css").read_text("utf-8")
    body = "\n".join(
        (
            _introduction(claims),
            *(_chapter(chapter, claims, pictures) for chapter in CHAPTERS),
            _parameters(setup),
        )
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>PTER: the paper and the simulation</title>\n<style>\n{style}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _introduction(claims: Sequence[Claim]) -> str:
    counts = Counter(claim.kind for claim in claims)
    words = "\n".join(
        f"<li>{_verdict(kind)} <strong>{counts[kind]}</strong> of {len(claims)}: {escape(meaning)}.</li>"
        for kind, meaning in MEANINGS.items()
    )
    missed = "\n".join(_missed(claim) for claim in claims if not claim.holds)
    shortfall = f'<h2>What is not met</h2>\n<ul class="verdicts">\n{missed}\n</ul>' if missed else ""
    return (
        "<h1>The paper and the simulation</h1>\n"
        "<p>Each claim of Swanson, Romagna, Book and Barraco, <cite>Influence of Actuator Dynamics on Passive Haptic "
        "Interface Performance</cite> (1999), that can be checked, beside what "
        f"pter_gym {escape(__version__)} gives. The paper prints few of the robot’s parameters; those used here are "
        'listed at the <a href="#parameters">end</a>, each with its origin.</p>\n'
        f'<ul class="verdicts">\n{words}\n</ul>\n{shortfall}'
    )


def _missed(claim: Claim) -> str:
    statement = claim.statement
    return (
        f"<li>{_verdict(claim.kind)} {_prose(statement.claim)} <small>{escape(statement.section)}; "
        f"{escape(statement.measured)}: {_value(claim)}, needed {escape(statement.condition)}. "
        f'<a href="#{statement.figure}">See there</a></small></li>'
    )


def _chapter(chapter: Chapter, claims: Sequence[Claim], pictures: Mapping[str, bytes]) -> str:
    sections = "\n".join(
        _section(name, [claim for claim in claims if claim.statement.figure == name], pictures)
        for name in chapter.products
    )
    return f"<h2>{escape(chapter.title)}</h2>\n<p>{_prose(chapter.text)}</p>\n{sections}"


def _section(name: str, claims: Sequence[Claim], pictures: Mapping[str, bytes]) -> str:
    product = PRODUCTS[name]
    images = "\n".join(
        f'<img alt="{escape(product.title)}" src="data:image/png;base64,{base64.b64encode(pictures[stem]).decode()}">'
        for stem in product.pictures
    )
    return (
        f'<section id="{name}">\n<h3>{escape(product.place)}: {escape(product.title)}</h3>\n'
        f"<p>{_prose(product.remark)}</p>\n{images}\n"
        f'<p class="data">Data: {name}.csv</p>\n{_claims(claims)}\n</section>'
    )


def _claims(claims: Sequence[Claim]) -> str:
    if not claims:
        return ""
    rows = "\n".join(_claim(claim) for claim in claims)
    return (
        '<table class="claims">\n<thead><tr><th>The paper says</th><th>We measure</th><th>It holds if</th>'
        f"<th>Verdict</th></tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
    )


def _claim(claim: Claim) -> str:
    statement = claim.statement
    remarks = " ".join(filter(None, (statement.note, "" if claim.holds else statement.reason)))
    remark = f"<small>{_prose(remarks)}</small>" if remarks else ""
    return (
        f"<tr><td>{_prose(statement.claim)} <small>{escape(statement.section)}</small></td>"
        f"<td><strong>{_value(claim)}</strong> <small>{escape(statement.measured)}</small></td>"
        f"<td>{escape(statement.condition)}</td><td>{_verdict(claim.kind)} {remark}</td></tr>"
    )


def _value(claim: Claim) -> str:
    unit = "" if claim.statement.unit == "1" else f" {claim.statement.unit}"
    return escape(f"{claim.value:.4g}{unit}".replace("-", "−"))


def _verdict(kind: Kind) -> str:
    return f'<span class="{kind.replace(" ", "-")}">{SIGNS[kind]}&nbsp;{kind.replace(" ", "&nbsp;")}</span>'


def _prose(text: str) -> str:
    """Return text as HTML, ``T_s`` and ``T_k`` with their subscripts."""
    return escape(text).replace("T_s", "<i>T</i><sub>s</sub>").replace("T_k", "<i>T</i><sub>k</sub>")


def _parameters(setup: Setup) -> str:
    groups = [(name.replace("_", " "), machine) for name, machine in setup.machines.items()]
    parts = [("the task", setup.task), ("the controller", setup.controller)]
    rows = "\n".join(_rows(name, part) for name, part in (*groups, *parts))
    choices = "\n".join(
        _row(item.name, getattr(setup, item.name), item.metadata)
        for item in fields(setup)
        if item.name not in ("machines", "task", "controller")
    )
    return (
        '<h2 id="parameters">The parameters</h2>\n'
        "<p>Published, derived, chosen, plausible or fitted: only a published value is a fact about the robot.</p>\n"
        '<table class="parameters">\n'
        "<thead><tr><th>Parameter</th><th>Value</th><th>Unit</th><th>Origin</th></tr></thead>\n"
        f'<tbody>\n<tr><th colspan="4">the experiments</th></tr>\n{choices}\n{rows}\n</tbody>\n</table>'
    )


def _rows(name: str, part: Any) -> str:
    return f'<tr><th colspan="4">{escape(name)}</th></tr>\n' + "\n".join(_leaves("", part))


def _leaves(prefix: str, part: Any) -> Iterable[str]:
    for item in fields(part):
        value = getattr(part, item.name)
        name = f"{prefix}{item.name}"
        if is_dataclass(value):
            yield from _leaves(f"{name}.", value)
        else:
            yield _row(name, value, item.metadata)


def _row(name: str, value: Any, metadata: Mapping[str, str]) -> str:
    unit = "" if metadata["unit"] == "1" else metadata["unit"]
    return (
        f"<tr><td>{escape(name)}</td><td>{escape(_text(value))}</td><td>{escape(unit)}</td>"
        f"<td>{escape(metadata['provenance'])}</td></tr>"
    )


def _text(value: Any) -> str:
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, tuple):
        return ", ".join(f"{number:.4g}" for number in cast(tuple[float, ...], value))
    return f"{value:.5g}"
