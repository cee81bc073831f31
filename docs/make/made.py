"""Blocks made from the code: README and the pages ask for them by `<!-- made: NAME … -->`."""

import inspect
import json
import pkgutil
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import MISSING, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

import docstring_parser
import pictures
import tyro
from markup import IMAGES, code, number, table

from pter_gym._commands.main import commands as find_commands, load_command
from pter_gym.controllers import CONTROLLERS
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.hands import LIBRARY_ARMS, LIBRARY_TREMORS
from pter_gym.hands._library import HandGrade
from pter_gym.params import ACTUATORS, Clutch, Hand
from pter_gym.policies import read_policy, shipped_policies
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.scenarios.distributions import LogUniform, OneOf, Shared, Uniform, Vary
from pter_gym.tasks.path_following import TELEMETRY, Sensors

MADE: dict[str, Callable[..., str]] = {}

SENSORS: tuple[Sensors, ...] = get_args(Sensors)


def made(function: Callable[..., str]) -> Callable[..., str]:
    """Offer a function to pages."""
    return MADE.setdefault(function.__name__, function)


def named(name: str) -> Any:
    """Return what a dotted name means."""
    return pkgutil.resolve_name(name)


# --- the environment ---


@made
def summary(name: str) -> str:
    """Return the first line of the docstring of a class."""
    return inspect.cleandoc(named(name).__doc__).partition("\n")[0]


@made
def docstring(name: str) -> str:
    """Return what follows the first line of the docstring of a class, which is Markdown."""
    return inspect.cleandoc(named(name).__doc__).partition("\n")[2]


@made
def parameters(name: str) -> str:
    """Fields of a class of parameters, with its defaults, or of an object, with its values."""
    owner = named(name)
    rows = (
        [
            code(item.name),
            item.metadata["unit"],
            value_text(item.default if isinstance(owner, type) else getattr(owner, item.name)),
            item.metadata["provenance"],
        ]
        for item in fields(owner)
    )
    return table(["Name", "Unit", "Value", "Provenance"], rows)


def value_text(value: Any) -> str:
    """A value of a field: numbers, or the names of records and their classes."""
    if value is MISSING:
        return "none"
    if isinstance(value, tuple):
        return ", ".join(getattr(each, "name", None) or number(each) for each in value)
    if isinstance(value, float):
        return number(value)
    if isinstance(value, int | str | None):
        return str(value)
    return code(f"{type(value).__name__}()")


@made
def observation() -> str:
    """Return all entries that an observation may contain, and the sensors that measure them."""
    names = {each: PathFollowingEnv(sensors=each).observation_layout.names for each in SENSORS}

    def measured_by(name: str) -> str:
        found = [each for each in SENSORS if name in names[each]]
        return "all" if len(found) == len(SENSORS) else ", ".join(map(code, found))

    layout = PathFollowingEnv(sensors="force").observation_layout
    rows = ([*entry(each), measured_by(each.name)] for each in layout.fields)
    return table(["Name", "Unit", "Scale", "Meaning", "Sensors"], rows)


@made
def context() -> str:
    """Return the entries that `observe_context` appends to an observation."""
    plain, whole = (
        PathFollowingEnv(observe_context=each).observation_layout for each in (False, True)
    )
    return table(["Name", "Unit", "Scale", "Meaning"], map(entry, whole.fields[len(plain) :]))


def entry(each: Any) -> list[str]:
    """Return the cells of an entry of an observation."""
    return [code(each.name), each.unit, f"{each.scale:g}", each.meaning]


@made
def telemetry() -> str:
    """Return the entries of telemetry."""
    return table(
        ["Name", "Unit", "Meaning"],
        ([code(each.name), each.unit, each.meaning] for each in TELEMETRY.fields),
    )


@made
def scores() -> str:
    """Return every score of an episode with its unit and meaning."""
    from pter_gym.benchmark.scores import METRICS

    rows = ([code(name), each.unit, each.meaning] for name, each in METRICS.items())
    return table(["Score", "Unit", "Meaning"], rows)


# --- scenarios ---


@made
def scenario(name: str) -> str:
    """Picture, id, episodes and what varies of a scenario."""
    found = find_scenario(name)
    drawn = [*varied("machine", found.draws.machine), *varied("task", found.draws.task)]
    return f"""\
![An episode of {name}](/images/moving/{name}.webp)

*`{pictures.BEST.get(name, pictures.SHOWN)}` on a training episode of `{name}`, in real time.*

```python
import gymnasium

env = gymnasium.make("pter_gym:{found.id}")
```

{found.asks} Each training episode draws:

{table(["What", "Unit", "Drawn"], drawn)}
The pace is drawn unless one is given. Everything else is as in
[the robot in equations](../model.md)."""


def varied(name: str, value: Any, unit: str = "1") -> Iterable[list[str]]:
    """Rows for what is drawn of a value: name, unit and distribution."""
    if isinstance(value, Vary):
        for item in fields(value.template):
            if item.name in value.fields:
                yield from varied(
                    f"{name}: {item.name}", value.fields[item.name], item.metadata["unit"]
                )
    elif isinstance(value, OneOf) and any(isinstance(each, Vary) for each in leaves(value)):
        kinds = [
            type(each.template if isinstance(each, Vary) else each).__name__
            for each in leaves(value)
        ]
        counted = (
            f"{kinds.count(kind)} " * (kinds.count(kind) > 1) + code(kind)
            for kind in dict.fromkeys(kinds)
        )
        yield [name, "–", "one of " + ", ".join(counted)]
        rows = [
            row
            for kind, each in zip(kinds, leaves(value), strict=True)
            for row in varied(f"{name} ({kind})", each)
        ]
        yield from (row for place, row in enumerate(rows) if row not in rows[:place])
    elif hasattr(value, "draw") or isinstance(value, tuple):
        yield [name, unit, described(value)]


def leaves(value: Any) -> list[Any]:
    """Options of a choice, and of choices among its options."""
    return (
        [leaf for each in value.options for leaf in leaves(each)]
        if isinstance(value, OneOf)
        else [value]
    )


def described(value: Any) -> str:
    """A distribution in words."""
    match value:
        case Uniform(low, high):
            return f"uniform in {number(low)} … {number(high)}"
        case LogUniform(low, high):
            return f"log-uniform in {number(low)} … {number(high)}"
        case Shared(common, individual, count):
            factors = f"one factor {described(common)}, times one each {described(individual)}"
            return f"{count} values: {factors}"
        case (first, *rest) as of if rest and all(each == first for each in rest):
            return f"{len(of)} values, each {described(first)}"
        case tuple() as of:
            return f"({'; '.join(map(described, of))})"
        case OneOf(options):
            return "one of " + "; ".join(map(described, options))
        case float():
            return number(value)
        case Hand(mass=mass, damping=damping, stiffness=stiffness):
            return f"{number(mass)} kg, {number(damping)} N·s/m, {number(stiffness)} N/m"
        case _:
            return str(value)


# --- machines, hands and the paper ---


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
        for arm in sorted(
            LIBRARY_ARMS.values(), key=lambda arm: get_args(HandGrade).index(arm.grade)
        )
    )
    header = [
        "Grade",
        "Name",
        "Mass [kg]",
        "Damping [N·s/m]",
        "Stiffness [N/m]",
        "Axes",
        "The person",
        "Source",
    ]
    return table(header, rows)


def torque_at_full_voltage(clutch: Clutch) -> str:
    """Return the dynamic torque at the largest voltage."""
    top = clutch.voltage_max
    return f"{clutch.dynamic.torque(top):.3g} at {top:g} V"


@made
def actuators() -> str:
    """The library's clutches and brakes, and where they come from."""
    rows = (
        [
            each.grade,
            code(each.name),
            torque_at_full_voltage(each.clutch),
            f"{each.clutch.dynamic.off_state:.3g}",
            f"{1e3 * each.clutch.time_constant:.3g}",
            f"{each.clutch.viscous:.3g}",
        ]
        for each in ACTUATORS.values()
    )
    header = ["Grade", "Name", "Torque [N·m]", "At 0 V", "Lag [ms]", "Viscous [N·m·s]"]
    sources = (
        f"- {code(each.name)}: {each.source}: {each.provenance}. "
        f"Not stated: {', '.join(map(code, each.unknown))}."
        for each in ACTUATORS.values()
    )
    return f"{table(header, rows)}\n" + "\n".join(sources) + "\n"


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
    return table(["Grade", "Name", "Band [Hz]", "Acceleration [m/s²]", "Source"], rows)


@made
def claims() -> str:
    """Return how many claims of the paper the run in docs/images/paper meets, and how."""
    stored = json.loads((IMAGES / "paper" / "claims.json").read_text("utf-8"))
    count = Counter(each["kind"] for each in stored)
    return (
        "`pter reproduce` makes the paper's figures and table, "
        f"and checks {len(stored)} of its claims:\n"
        f"{count['prediction']} are predictions that hold, "
        f"{count['calibration']} hold because parameters were fitted\n"
        f"to them, and {count['not met']} are "
        "[not met](/tables.md#the-papers-claims).\n"
    )


@made
def claim_table() -> str:
    """Return the paper's claims with what the run measured that docs/images/paper holds."""
    verdicts = {
        "prediction": "✓ prediction",
        "calibration": "≈ calibration",
        "not met": "✗ not met",
    }
    rows = [
        [
            verdicts[each["kind"]],
            f"“{each['paper']}” {each['section']}",
            each["claim"],
            " ".join([number(each["measured"]), each["unit"].removeprefix("1")]).strip()
            + f": {each['what']}",
            each["condition"],
        ]
        for each in json.loads((IMAGES / "paper" / "claims.json").read_text("utf-8"))
    ]
    head = ["Verdict", "The paper says, in section", "Read as", "We measure", "Holds if"]
    return table(head, rows)


# --- policies and commands ---


@made
def policies() -> str:
    """A card with a picture for each policy of the leaderboards."""
    cards = (
        f"- ![{name} at the end of its episode](/images/policies/{name}.webp)\n\n"
        f"  **{name}.** {policy_text(name)}\n"
        for name in pictures.policy_names()
    )
    return cards_of(cards)


def cards_of(cards: Iterable[str]) -> str:
    """Cards side by side; where styles are not known, a list."""
    return '<div class="cards">\n\n' + "\n".join(cards) + "\n</div>"


def policy_text(name: str) -> str:
    """What a policy is, in its own words."""
    if name in shipped_policies():
        about = read_policy(name).about
        below = (
            f"Corrections to `{about['corrects']}`"
            if about.get("corrects")
            else "The four voltages"
        )
        where = (
            "all scenarios except `corridor` and `wall`"
            if about["scenario"] == "all"
            else f"`{about['scenario']}`"
        )
        return f"{below}, learned by `{about['algorithm']}` on {where}."
    law = name.removesuffix("-tuned")
    if law != name and law in pictures.policy_names():
        return f"`{law}` with tuned gains."
    known = inspect.getdoc(CONTROLLERS[law]) or ""
    gains = " With tuned gains." if law != name else ""
    return " ".join(known.split("\n\n")[0].split()).replace("``", "`") + gains


@made
def scenarios() -> str:
    """A card with a moving picture for each scenario."""
    cards = (
        f"- ![An episode of {name}](/images/moving/{name}.webp)\n\n"
        f"  **[{name}](/scenarios/{name}.md).** {each.asks}\n"
        for name, each in SCENARIOS.items()
    )
    return cards_of(cards)


@made
def commands() -> str:
    """Return all commands, with what each is for."""
    rows = (
        [f"[`pter {name}`](/commands/{name}.md)", documented(name).short_description or ""]
        for name in find_commands()
    )
    return table(["Command", "What it does"], rows)


def documented(name: str) -> docstring_parser.Docstring:
    """Return the parsed docstring of a command."""
    return docstring_parser.parse(inspect.getdoc(load_command(name)) or "")


@made
def command(name: str) -> str:
    """Return what a command does, an example and its arguments."""
    function, doc = load_command(name), documented(name)
    text, example = re.fullmatch(
        r"(.*?)\s*Example: `?(.*?)`?", doc.description or "", re.DOTALL
    ).groups()  # type: ignore[union-attr]
    meanings = {each.arg_name: each.description or "" for each in doc.params}
    hints = get_type_hints(function, include_extras=True)
    rows: list[list[str]] = []
    for each in inspect.signature(function).parameters.values():
        option, usual, meaning = argument(hints[each.name], each, meanings.get(each.name, ""))
        rows.append([option, meaning, usual])
    return "\n\n".join(
        [
            with_options_as_code(text),
            f"```sh\n{example}\n```",
            table(["Argument", "What it is", "Default"], rows),
        ]
    )


def argument(hint: Any, parameter: inspect.Parameter, meaning: str) -> list[str]:
    """Return the cells of an argument: how it is typed, its default, what it is."""
    kind, *annotations = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
    given = [each for each in annotations if type(each).__name__ == "_ArgConfig"]
    meaning = meaning or next((each.help for each in given if each.help), "")
    name = next((each.name for each in given if each.name), None) or parameter.name
    option = f"--{name.replace('_', '-')}"
    if tyro.conf.Positional in get_args(hint):
        option = name.upper()
    elif kind is bool:
        option += f", --no-{option[2:]}"
    if names := choices(hint):
        meaning += f" One of {', '.join(map(code, names))}."
    text = with_options_as_code(" ".join(meaning.split()))
    return [code(option), default_text(parameter.default), text]


def with_options_as_code(text: str) -> str:
    """Return a text whose options are code: Sphinx would make a dash of two hyphens."""
    return re.sub(r"`[^`]*`|--[a-z-]+", lambda found: code(found[0].strip("`")), text)


def aliases(hint: Any) -> list[str]:
    """Return further names of an option."""
    return [name for each in get_args(hint) for name in getattr(each, "aliases", None) or ()]


def choices(hint: Any) -> list[str]:
    """Return the names that an argument accepts."""
    (kind,) = get_args(hint)[:1] if hasattr(hint, "__metadata__") else (hint,)
    parts = (part for part in (kind, *get_args(kind)) if get_origin(part) is Literal)
    return [str(each) for part in parts for each in get_args(part)]


def default_text(value: Any) -> str:
    """Return how a table shows the default of an argument."""
    match value:
        case None | "" | () | inspect.Parameter.empty:
            return ""
        case bool():
            return "yes" if value else "no"
        case int():
            return f"{value:,}"
        case tuple():
            return code(" ".join(value))
        case _:
            return code(str(value))
