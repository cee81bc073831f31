"""What pages take from the code, as Markdown: `fill.py` puts it between `<!-- made: NAME … -->` and its end."""

import inspect
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_type_hints

import docstring_parser
import pictures
import tyro
from declared import code, fields_table
from pages import DOCS, IMAGES, ROOT, signed, text_table

from pter_gym._commands.main import commands as find_commands
from pter_gym._commands.main import load_command
from pter_gym._commands.names import names_of
from pter_gym._internal.plugins import summary as summary_of
from pter_gym.controllers import CONTROLLERS
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.hands import LIBRARY_ARMS, LIBRARY_TREMORS
from pter_gym.hands._library import Grade
from pter_gym.params import Hand
from pter_gym.params._fields import SHIPPED
from pter_gym.policies import read_policy, shipped_policies
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario
from pter_gym.scenarios.randomisation import LogUniform, OneOf, Repeat, Shared, Tuple, Uniform, Vary
from pter_gym.tools.paper.reproduce.chapters import PRODUCTS
from pter_gym.tools.paper.reproduce.report import SIGNS

MADE: dict[str, Callable[..., str]] = {}


def made(function: Callable[..., str]) -> Callable[..., str]:
    """Offer a function to pages."""
    MADE[function.__name__] = function
    return function


def named(name: str) -> Any:
    """Return what a dotted name means."""
    module, _, attribute = name.rpartition(".")
    return getattr(import_module(module), attribute)


def number(value: float) -> str:
    """Return a number with a typographic minus sign."""
    return signed(f"{value:.4g}")


@made
def summary(name: str) -> str:
    """The first line of the docstring of a class."""
    return inspect.cleandoc(named(name).__doc__).partition("\n")[0]


@made
def docstring(name: str) -> str:
    """What follows the first line of the docstring of a class, which is Markdown."""
    return inspect.cleandoc(named(name).__doc__).partition("\n")[2]


@made
def parameters(name: str) -> str:
    """Fields of a class of parameters."""
    return fields_table(named(name))


@made
def readme(*name: str) -> str:
    """The block of code below the comment of this name in README.md."""
    comment, text = re.escape(" ".join(name)), (ROOT / "README.md").read_text("utf-8")
    (block,) = re.findall(rf"^<!-- {comment} -->\n(```.*?^```)$", text, re.MULTILINE | re.DOTALL)
    return block


@made
def spaces() -> str:
    """Both spaces of the environment, by its arguments."""
    units, sensors = ("volt", "normalised"), ("encoders", "torque", "force")
    rows = [["action", f'action_unit="{each}"', PathFollowingEnv(action_unit=each).action_space] for each in units]
    rows += [["observation", f'sensors="{each}"', PathFollowingEnv(sensors=each).observation_space] for each in sensors]
    return text_table(
        ["Space", "Argument", "What it is"], ([name, code(how), code(str(what))] for name, how, what in rows)
    )


@made
def scenario(name: str) -> str:
    """Picture, id, episodes and what varies of a scenario."""
    found = find_scenario(name)
    drawn = [*varied("machine", found.machine), *varied("task", found.task)]
    drawn.append(["task: pace", "m/s", described(LogUniform(min(PACES.values()), max(PACES.values())))])
    return f"""\
![An episode of {name}](/images/moving/{name}.webp)

*`{pictures.SHOWN}` on one drawn episode of `{name}`, in real time.*

```python
env = gymnasium.make("{found.id}")
```

{found.asks} Each training episode draws:

{text_table(["What", "Unit", "Drawn"], drawn)}
The pace is drawn unless one is given. Everything else is as in [the robot in equations](../model.md)."""


def varied(name: str, value: Any, unit: str = "1") -> Iterable[list[str]]:
    """Rows for what is drawn of a value: name, unit and distribution."""
    if isinstance(value, Vary):
        for item in fields(value.base):
            if item.name in value.fields:
                yield from varied(f"{name}: {item.name}", value.fields[item.name], item.metadata["unit"])
    elif isinstance(value, OneOf) and any(isinstance(each, Vary) for each in leaves(value)):
        kinds = [type(each.base if isinstance(each, Vary) else each).__name__ for each in leaves(value)]
        counted = (f"{kinds.count(kind)} " * (kinds.count(kind) > 1) + code(kind) for kind in dict.fromkeys(kinds))
        yield [name, "–", "one of " + ", ".join(counted)]
        rows = [
            row for kind, each in zip(kinds, leaves(value), strict=True) for row in varied(f"{name} ({kind})", each)
        ]
        yield from (row for place, row in enumerate(rows) if row not in rows[:place])
    elif hasattr(value, "draw"):
        yield [name, unit, described(value)]


def leaves(value: Any) -> list[Any]:
    """Options of a choice, and of choices among its options."""
    return [leaf for each in value.options for leaf in leaves(each)] if isinstance(value, OneOf) else [value]


def described(value: Any) -> str:
    """A distribution in words."""
    match value:
        case Uniform(low, high):
            return f"uniform in {number(low)} … {number(high)}"
        case LogUniform(low, high):
            return f"log-uniform in {number(low)} … {number(high)}"
        case Repeat(of, count):
            return f"{count} values, each {described(of)}"
        case Shared(common, own, count):
            return f"{count} values: one factor {described(common)}, times one each {described(own)}"
        case Tuple(of):
            return f"({'; '.join(map(described, of))})"
        case OneOf(options):
            return "one of " + "; ".join(map(described, options))
        case float():
            return number(value)
        case Hand(mass=mass, damping=damping, stiffness=stiffness):
            return f"{number(mass)} kg, {number(damping)} N·s/m, {number(stiffness)} N/m"
        case _:
            return str(value)


@made
def preset(section: str) -> str:
    """Numbers of a section of the preset: value, unit and where each comes from."""
    rows: list[list[str]] = []
    for name, entry in SHIPPED[section].items():
        value = entry["value"]
        shown = ", ".join(map(number, value if isinstance(value, list) else (value,)))
        rows.append([code(name), shown, entry["unit"], entry["from"]])
    return text_table(["Name", "Value", "Unit", "Provenance"], rows)


@made
def arms() -> str:
    """The library's arms by grade: their symmetric matrices and where they come from."""

    def matrix(given: Any) -> str:
        (a, b), (_, d) = given
        return ", ".join(number(each) for each in ((a, d) if b == 0.0 else (a, b, d)))

    rows = (
        [
            arm.grade,
            code(arm.name),
            *map(matrix, (arm.mass, arm.damping, arm.stiffness)),
            arm.axes,
            arm.posture,
            f"{arm.source}: {arm.provenance}",
        ]
        for arm in sorted(LIBRARY_ARMS.values(), key=lambda arm: get_args(Grade).index(arm.grade))
    )
    header = ["Grade", "Name", "Mass [kg]", "Damping [N·s/m]", "Stiffness [N/m]", "Axes", "The person", "Source"]
    return text_table(header, rows)


@made
def tremors() -> str:
    """The library's tremors: bands, amplitudes, and where they come from."""
    rows = (
        [
            each.grade,
            code(each.name),
            *(" … ".join(f"{end:.2g}" for end in ends) for ends in (each.band, each.acceleration)),
            f"{each.source}: {each.provenance}",
        ]
        for each in LIBRARY_TREMORS.values()
    )
    return text_table(["Grade", "Name", "Band [Hz]", "Acceleration [m/s²]", "Source"], rows)


@made
def paper() -> str:
    """Each figure and table of the paper: our picture, and its claims with what was measured."""
    claims: list[dict[str, Any]] = json.loads((IMAGES / "paper" / "claims.json").read_text("utf-8"))
    parts: list[str] = []
    for name, product in PRODUCTS.items():
        shown = "\n\n".join(f"![{product.title}](/images/paper/{stem}.png)" for stem in product.pictures)
        rows = [
            [
                f"{SIGNS[each['kind']]} {each['kind']}",
                each["claim"],
                f"{number(each['measured'])}{'' if each['unit'] == '1' else ' ' + each['unit']}: {each['what']}",
                each["section"],
            ]
            for each in claims
            if each["figure"] == name
        ]
        said = text_table(["Verdict", "The paper says", "We measure", "Section"], rows) if rows else ""
        parts.append(f"## {product.place}: {product.title}\n\n{product.remark}\n\n{shown}\n\n{said}")
    return "\n\n".join(parts)


@made
def policies() -> str:
    """A card with a picture for each policy of the leaderboards."""
    cards = (
        f"- ![{name} at the end of its episode](/images/policies/{name}.webp)\n\n  **{name}.** {policy_text(name)}\n"
        for name in pictures.policy_names()
    )
    return cards_of(cards)


def cards_of(cards: Iterable[str]) -> str:
    """Cards side by side; where styles are not known, a list."""
    return '<div class="cards">\n\n' + "\n".join(cards) + "\n</div>"


def policy_text(name: str) -> str:
    """What a policy is, in its own words."""
    if name in shipped_policies():
        about = read_policy(name).card.about
        below = f"Corrections to `{about['corrects']}`" if about.get("corrects") else "The four voltages"
        where = "all scenarios except `tremor`" if about["scenario"] == "all" else f"`{about['scenario']}`"
        return f"{below}, learned by `{about['algorithm']}` on {where}."
    known = inspect.getdoc(CONTROLLERS[name.removesuffix("-tuned")]) or ""
    gains = " With tuned gains." if name.endswith("-tuned") else ""
    return " ".join(known.split("\n\n")[0].split()).replace("``", "`") + gains


@made
def scenarios() -> str:
    """A card with a moving picture for each scenario."""
    cards = (
        f"- ![An episode of {name}](/images/moving/{name}.webp)\n\n  **[{name}](scenarios/{name}.md).** {each.asks}\n"
        for name, each in SCENARIOS.items()
    )
    return cards_of(cards)


@made
def commands() -> str:
    """All commands, with what each is for."""
    rows = ([f"[`pter {name}`](commands/{name}.md)", summary_of(entry)] for name, entry in find_commands().items())
    return text_table(["Command", "What it does"], rows)


@made
def command(name: str) -> str:
    """What a command does, an example, its arguments and the names that they accept."""
    function = load_command(name)
    told = docstring_parser.parse(inspect.getdoc(function) or "")
    text, example = re.fullmatch(r"(.*?)\s*Example: `?(.*?)`?", told.description or "", re.DOTALL).groups()  # type: ignore[union-attr]
    meanings = {each.arg_name: each.description or "" for each in told.params}
    hints = get_type_hints(function, include_extras=True)
    rows = (
        argument_row(hints[each.name], each, meanings.get(each.name))
        for each in inspect.signature(function).parameters.values()
    )
    parts = [text, f"```sh\n{example}\n```", text_table(["Argument", "Default", "What it is"], rows)]
    names = [[kind, ", ".join(map(code, names))] for kind, names in names_of(function).items()]
    return "\n\n".join(map(str.strip, [*parts, *([text_table(["Names", "Accepted"], names)] if names else [])]))


def argument_row(hint: Any, argument: inspect.Parameter, meaning: str | None) -> list[str]:
    """A row for an argument: how it is typed, its default, what it is."""
    told = [each for each in get_args(hint) if type(each).__name__ == "_ArgConfig"]
    metavar = next((each.metavar for each in told if each.metavar), None)
    meaning = meaning or next((each.help for each in told if each.help), "")
    name = next((each.name for each in told if each.name), None) or argument.name
    kind = (get_args(hint) or (hint,))[0]
    value = metavar or {int: "INT", float: "FLOAT", Path: "PATH", str: "TEXT"}.get(kind, "TEXT")
    if tyro.conf.Positional in get_args(hint):
        return [code(metavar or argument.name.upper()), "", " ".join(meaning.split())]
    option = f"--{name.replace('_', '-')}"
    typed = f"{option}, --no-{option[2:]}" if kind is bool else f"{option} {value}"
    return [code(typed), default_text(argument.default), " ".join(meaning.split())]


def default_text(value: Any) -> str:
    """How a table shows the default of an argument."""
    match value:
        case None:
            return ""
        case bool():
            return "yes" if value else "no"
        case int():
            return f"{value:,}"
        case _:
            return code(str(value))


def markdown(page: Path, asked: str) -> str:
    """What a block of a page asks for; links to pictures are relative to the page."""
    name, *given = asked.split()
    up = "../" * len(page.relative_to(DOCS).parts[1:])
    return MADE[name](*given).strip().replace("](/images/", f"]({up}images/") + "\n"
