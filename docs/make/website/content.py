"""What pages take from the code when the site is built, as Markdown: the functions of the directive `{made}`."""

import inspect
import json
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout, suppress
from dataclasses import fields
from importlib import import_module
from io import StringIO
from typing import Any

import moving_pictures
from pages import IMAGES, ROOT
from record_tables import fields_table, rows_table

from pter_gym.commands.main import commands as find_commands
from pter_gym.commands.main import main as run_command
from pter_gym.controllers import CONTROLLERS
from pter_gym.envs.single import PathFollowingEnv
from pter_gym.hands import MEASURED_ARMS, MEASURED_TREMORS
from pter_gym.hands.library import Matrix
from pter_gym.paper.reproduce.figures import PRODUCTS
from pter_gym.params import Hand
from pter_gym.params.preset import PRESET, SECTIONS
from pter_gym.policies import load_policy, shipped_policies
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.scenarios.randomisation import LogUniform, OneOf, Repeat, Shared, Tuple, Uniform, Vary

SIGNS = {"reproduced": "✓", "calibrated": "≈", "not met": "✗"}


def summary(name: str) -> str:
    """The first line of the docstring of a class."""
    return _text(name).partition("\n")[0]


def docstring(name: str) -> str:
    """What follows the first line of the docstring of a class, which is Markdown."""
    return _text(name).partition("\n")[2]


def _text(name: str) -> str:
    module, _, attribute = name.rpartition(".")
    return inspect.getdoc(getattr(import_module(module), attribute)) or ""


def readme(*name: str) -> str:
    """The block of code below the comment of this name in README.md."""
    marker = re.escape(" ".join(name))
    (block,) = re.findall(
        rf"^<!-- {marker} -->\n(```.*?^```)$", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    return block


def spaces() -> str:
    """Both spaces of the environment, by its arguments."""
    env = PathFollowingEnv()
    sensors = {each: PathFollowingEnv(sensors=each) for each in ("encoders", "torque", "force")}
    rows = [["action", '`action_unit="volt"`', f"`{env.action_space}`"]]
    rows += [["action", '`action_unit="normalised"`', f"`{PathFollowingEnv(action_unit='normalised').action_space}`"]]
    rows += [["observation", f'`sensors="{name}"`', f"`{each.observation_space}`"] for name, each in sensors.items()]
    return rows_table(["Space", "Argument", "What it is"], rows)


def scenario(name: str) -> str:
    """Picture, id, episodes and what varies of a scenario."""
    found = find_scenario(name)
    drawn = [*varied("machine", found.machine), *varied("task", found.task)]
    drawn.append(["task: pace", "m/s", described(LogUniform(min(PACES.values()), max(PACES.values())))])
    return "\n".join(
        [
            f"```{{figure}} /images/moving/{name}.webp\n:alt: An episode of {name}",
            f":class: moving\n\n`{moving_pictures.ALONE}` on one drawn episode of `{name}`, in real time.\n```",
            "",
            f"```python\nenv = gymnasium.make({found.id!r})\n```".replace("'", '"'),
            "",
            f"{found.asks} Each training episode draws:",
            "",
            rows_table(["What", "Unit", "Drawn"], drawn),
            "The pace is drawn where none is given. All else is as in [the robot in equations](../model.md).",
        ]
    )


def varied(name: str, value: Any, unit: str = "1") -> Iterable[list[str]]:
    """Rows for what is drawn of a value: name, unit and distribution."""
    if isinstance(value, Vary):
        for item in fields(value.base):
            if item.name in value.fields:
                yield from varied(f"{name}: {item.name}", value.fields[item.name], item.metadata["unit"])
    elif isinstance(value, OneOf) and any(isinstance(each, Vary) for each in leaves(value)):
        kinds = Counter(map(kind, leaves(value)))
        yield [name, "–", "one of " + ", ".join(kind_text(*each) for each in kinds.items())]
        shown: set[str] = set()
        for each in leaves(value):
            rows = [*varied(f"{name} ({kind(each)})", each)]
            yield from (row for row in rows if str(row) not in shown)
            shown.update(map(str, rows))
    elif hasattr(value, "draw"):
        yield [name, unit, described(value)]


def leaves(value: Any) -> list[Any]:
    """Options of a choice, and of choices among its options."""
    return [leaf for each in value.options for leaf in leaves(each)] if isinstance(value, OneOf) else [value]


def kind(value: Any) -> str:
    """Name of the class of a value, or of what varies."""
    return type(value.base if isinstance(value, Vary) else value).__name__


def kind_text(name: str, count: int) -> str:
    """A kind, and how many of it there are."""
    return f"`{name}`" if count == 1 else f"{count} `{name}`"


def described(value: Any) -> str:
    """A distribution in words."""
    match value:
        case Uniform(low, high):
            return f"even in {number(low)} … {number(high)}"
        case LogUniform(low, high):
            return f"logarithm even in {number(low)} … {number(high)}"
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


def number(value: float) -> str:
    """A number with a typographic minus sign."""
    return f"{value:.4g}".replace("-", "−")


def preset(section: str) -> str:
    """Numbers of a section of the preset: value, unit and where each comes from."""
    values = getattr(PRESET, section)
    rows = [
        [f"`{item.name}`", shown(getattr(values, item.name)), item.metadata["unit"], origin(section, item.name)]
        for item in fields(SECTIONS[section])
    ]
    return rows_table(["Name", "Value", "Unit", "Provenance"], rows)


def origin(section: str, name: str) -> str:
    """Where a number of the preset comes from."""
    return PRESET.provenance[f"{section}.{name}"]


def shown(value: float | tuple[float, ...]) -> str:
    """A number or several."""
    return ", ".join(map(number, value)) if isinstance(value, tuple) else number(value)


def parameters(name: str) -> str:
    """Fields of a class of parameters."""
    module, _, attribute = name.rpartition(".")
    return fields_table(getattr(import_module(module), attribute))


def arms() -> str:
    """The measured arms: their matrices, what they are to the simulator, and where they come from."""
    header = ["Name", "Mass [kg]", "Damping [N·s/m]", "Stiffness [N/m]", "Axes", "The person", "Grade", "Where from"]
    rows = [
        [
            f"`{arm.name}`",
            *(matrix_text(given) for given in (arm.mass, arm.damping, arm.stiffness)),
            arm.axes,
            arm.posture,
            arm.grade,
            f"{arm.source}: {arm.provenance}",
        ]
        for arm in MEASURED_ARMS.values()
    ]
    return rows_table(header, rows)


def matrix_text(matrix: Matrix) -> str:
    """A symmetric matrix: its diagonal, and what is beside that if it is not zero."""
    (a, b), (_, d) = matrix
    return ", ".join(number(x) for x in ((a, d) if b == 0.0 else (a, b, d)))


def tremors() -> str:
    """The measured tremors: bands, amplitudes, and where they come from."""
    rows = [
        [
            f"`{each.name}`",
            *map(range_text, (each.band, each.acceleration)),
            each.grade,
            f"{each.source}: {each.provenance}",
        ]
        for each in MEASURED_TREMORS.values()
    ]
    return rows_table(["Name", "Band [Hz]", "Acceleration [m/s²]", "Grade", "Where from"], rows)


def range_text(ends: tuple[float, float]) -> str:
    """From and to."""
    return " … ".join(f"{end:.2g}" for end in ends)


def paper() -> str:
    """Each figure and table of the paper beside what it claims."""
    claims = json.loads((IMAGES / "paper" / "claims.json").read_text("utf-8"))
    return "\n\n".join(figure(name, [each for each in claims if each["figure"] == name]) for name in PRODUCTS)


def figure(name: str, claims: list[dict[str, Any]]) -> str:
    """One figure of the paper: our picture, and its claims with what was measured."""
    product = PRODUCTS[name]
    pictures = "\n\n".join(f"![{product.title}](/images/paper/{stem}.png)" for stem in product.pictures)
    rows = [
        [f"{SIGNS[each['kind']]} {each['kind']}", each["claim"], measured(each), each["section"]] for each in claims
    ]
    said = rows_table(["Verdict", "The paper says", "We measure", "Section"], rows) if rows else ""
    return f"## {product.place}: {product.title}\n\n{product.remark}\n\n{pictures}\n\n{said}"


def measured(claim: dict[str, Any]) -> str:
    """What was measured for a claim."""
    unit = "" if claim["unit"] == "1" else f" {claim['unit']}"
    return f"{number(claim['measured'])}{unit}: {claim['what']}"


def policies() -> str:
    """A card with a picture for each policy of the leaderboards."""
    cards = [
        f"- ![{name} at the end of its episode](/images/policies/{name}.webp)\n\n  **{name}.** {policy_text(name)}\n"
        for name in moving_pictures.policy_names()
    ]
    return "{.cards}\n" + "\n".join(cards)


def policy_text(name: str) -> str:
    """What a policy is, in its own words."""
    if name in shipped_policies():
        about = load_policy(name).card.about
        below = f"Corrections to `{about['corrects']}`" if about.get("corrects") else "The four voltages"
        where = "all scenarios but `tremor`" if about["scenario"] == "all" else f"`{about['scenario']}`"
        return f"{below}, learned by `{about['algorithm']}` on {where}."
    known = inspect.getdoc(CONTROLLERS[name.removesuffix("-tuned")]) or ""
    gains = " With tuned gains." if name.endswith("-tuned") else ""
    return " ".join(known.split("\n\n")[0].split()).replace("``", "`") + gains


def scenarios() -> str:
    """A card with a moving picture for each scenario."""
    names = [name for name in moving_pictures.PICTURES if name not in ("side-by-side", "policies")]
    cards = [
        f"- ![An episode of {name}](/images/moving/{name}.webp)\n\n  "
        f"**[{name}](scenarios/{name}.md).** {find_scenario(name).asks}\n"
        for name in names
    ]
    return "{.cards}\n" + "\n".join(cards)


def commands() -> str:
    """What each command says of itself."""
    return "\n".join(f"## pter {name}\n\n```text\n{help_of(name)}\n```\n" for name in find_commands())


def help_of(*arguments: str) -> str:
    """What `pter … --help` prints."""
    os.environ["COLUMNS"] = "88"
    with redirect_stdout(StringIO()) as printed, suppress(SystemExit):
        run_command([*arguments, "--help"])
    return re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue()).strip()


MADE: dict[str, Callable[..., str]] = {
    each.__name__: each
    for each in (
        summary,
        docstring,
        readme,
        spaces,
        scenario,
        preset,
        parameters,
        arms,
        tremors,
        paper,
        policies,
        scenarios,
        commands,
    )
}
