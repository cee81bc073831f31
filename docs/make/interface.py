"""List the public interface: `python docs/make/interface.py` writes tests/meta/interface.txt.

It has a line for each name of the modules in docs/api.md, up to those behind the commands, with
parameters, defaults, fields and values, and the lines of `formats.py`. A digest stands for a value
of many numbers.
"""

import dataclasses
import enum
import inspect
import json
import pkgutil
import re
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

from markup import DOCS, ROOT

from pter_gym import __version__
from pter_gym.scenarios._suite import YOUNGER

LISTING = ROOT / "tests" / "meta" / "interface.txt"

PLAIN = (bool, int, float, str, type(None))

PROSE = {"asks", "grade", "posture", "provenance", "source", "title"}
"""Fields whose text may be written better."""


def modules(*, behind: bool) -> list[str]:
    """Return the names of the modules in docs/api.md, with or without those behind the commands."""
    page, mark, rest = (DOCS / "api.md").read_text("utf-8").partition("## Behind the commands")
    assert mark
    text = page + rest if behind else page
    return re.findall(r"^   (pter_gym[\w.]*)$", text, re.MULTILINE)


def lines() -> Iterator[str]:
    """Yield the lines of the listing."""
    for name in modules(behind=False):
        yield from lines_of_module(pkgutil.resolve_name(name))
    import formats  # needs what the extra `agents` brings

    yield from formats.lines()


def lines_of_module(module: ModuleType) -> Iterator[str]:
    """Yield a line for each public name of a module and each member of its classes."""
    names = getattr(module, "__all__", None) or [
        name
        for name, value in vars(module).items()
        if getattr(value, "__module__", "") == module.__name__
    ]
    for name in sorted(names):
        value = getattr(module, name)
        if name.startswith("_") or inspect.ismodule(value):
            continue
        place = f"{module.__name__}.{name}"
        if get_origin(value) is Literal:
            yield f"{place} = {' | '.join(get_args(value))}"
        elif inspect.isclass(value):
            yield from lines_of_class(place, value)
        elif callable(value):
            yield f"{place}{signature(value)}"
        elif isinstance(value, Mapping):
            yield from (f"{place}[{key!r}] = {default(each)}" for key, each in value.items())
        else:
            yield f"{place} = {default(value)}"


def lines_of_class(place: str, kind: type) -> Iterator[str]:
    """Yield what makes an instance of a class, and its public members."""
    bases = [base for base in kind.__mro__[1:] if not base.__module__.startswith("pter_gym")]
    inherited = {name for base in bases for name in vars(base)}
    is_made = not (issubclass(kind, enum.Enum | BaseException) or vars(kind).get("_is_protocol"))
    if issubclass(kind, BaseException):
        yield f"{place}({', '.join(base.__name__ for base in kind.__mro__[1:-2])})"
    else:
        yield f"{place}{signature(kind)}" if is_made else place
    for name in sorted(dir(kind)):
        if name.startswith("_") or name in inherited:
            continue
        member = inspect.getattr_static(kind, name)
        if isinstance(member, staticmethod | classmethod):
            member = member.__func__
        if inspect.isfunction(member):
            yield f"{place}.{name}{signature(member)}"
        elif issubclass(kind, enum.Enum):
            yield f"{place}.{name} = {default(getattr(kind, name).value)}"
        else:
            yield f"{place}.{name}"


def signature(function: Any) -> str:
    """Return names, kinds and defaults of parameters."""
    plain = [
        each.replace(
            annotation=each.empty,
            default=each.default if each.default is each.empty else Text(default(each.default)),
        )
        for each in inspect.signature(function).parameters.values()
    ]
    return str(inspect.Signature(plain))


class Text(str):
    """A default that is shown as it is."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the text."""
        return str(self)


def default(value: object) -> str:
    """Return plain data as code, and of others what they are: a name, or a kind and a digest."""
    if value == __version__:
        return "<version>"
    if isinstance(value, tuple) and all(isinstance(each, PLAIN) for each in value):
        return repr(tuple(value))
    if isinstance(value, PLAIN):
        return repr(value)
    if isinstance(value, type) or inspect.isfunction(value):
        return f"<{value.__name__}>"
    if dataclasses.is_dataclass(value) or isinstance(value, tuple):
        return f"<{type(value).__name__} {digest(value)}>"
    return f"<{type(value).__name__.strip('_')}>"


def digest(value: Any) -> str:
    """Return a digest of a value's names and numbers, these to nine digits."""

    def plain(each: Any) -> Any:
        if dataclasses.is_dataclass(each) and not isinstance(each, type):
            parts = {
                f.name: getattr(each, f.name)
                for f in dataclasses.fields(each)
                if f.name not in PROSE
                and getattr(each, f.name) != YOUNGER.get(f.name, dataclasses.MISSING)
            }
            return [type(each).__name__, plain(parts)]
        if isinstance(each, Mapping):
            return {str(name): plain(part) for name, part in each.items()}
        if isinstance(each, Sequence) and not isinstance(each, str):
            return [plain(part) for part in each]
        return f"{each:.9g}" if isinstance(each, float) else each

    return sha256(json.dumps(plain(value)).encode()).hexdigest()[:8]


def listing() -> str:
    """Return the listing."""
    return "".join(f"{line}\n" for line in lines())


if __name__ == "__main__":
    LISTING.write_text(listing(), "utf-8")
