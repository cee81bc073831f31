"""Policies as users write them: attributes of a file of Python, or of a module."""

import hashlib
import linecache
import sys
from importlib.machinery import SourceFileLoader
from importlib.metadata import EntryPoint
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any, cast

from pter_gym._internal.files import has_ending
from pter_gym.errors import ParameterError, nearest

LIBRARIES = ("pter_gym.", "functools", "builtins")
"""Whose objects say nothing of the code that acts through them."""


def load_attribute(name: str) -> Any:
    """Return the policy that is an attribute of a module, or an instance of it if it is a class."""
    from numba.core.dispatcher import Dispatcher

    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    place, _, attribute = name.rpartition(":")
    entry = EntryPoint(name, name, "")
    if not has_ending(place, ".py") and not entry.pattern.fullmatch(name):
        raise ParameterError(
            f"policies must be written as package.module:attribute, got {name!r:.200}"
        )
    try:
        is_file = has_ending(place, ".py")
        value = _attribute_of(Path(place), attribute) if is_file else _load(entry)
        if isinstance(value, Dispatcher):
            raise ParameterError(
                f"policies must name a class whose bind returns the law, {name!r} is the law itself"
            )
        return value() if isinstance(value, type) else value
    except (ImportError, AttributeError) as error:
        raise ParameterError(
            f"policies must name code that can be imported, got {name!r}: {error}"
        ) from None
    except TypeError as error:
        raise ParameterError(
            "policies must name an instance, or a class that needs no arguments, "
            f"got {name!r}: {error}"
        ) from None


def _attribute_of(file: Path, name: str) -> Any:
    """Return an attribute of a file of Python."""
    attributes = {
        each: value
        for each, value in vars(_run_file(file.resolve())).items()
        if not each.startswith("_")
    }
    if name not in attributes:
        raise ParameterError(
            f"policies must name what is in {file}, there is no {name!r}{nearest(name, attributes)}"
        )
    return attributes[name]


def code_digest(policy: Any) -> str:
    """Return a digest of a user's code that acts: of its compiled function, otherwise of its file.

    It is empty where the code is a library's or unknown, as that of a trained model.
    """
    from pter_gym._compiled.digests import digest_of

    law = getattr(policy, "law", None)
    if law is not None and (digest := digest_of(law.function)):
        return digest
    maker = cast("type", policy if hasattr(policy, "__qualname__") else type(policy))
    module = sys.modules.get(maker.__module__)
    content: bytes | None = getattr(module, "__content__", None)
    file = getattr(module, "__file__", None)
    if content is None and file and not maker.__module__.startswith(LIBRARIES):
        content = Path(file).read_bytes()
    return hashlib.sha256(content).hexdigest() if content else ""


def _load(entry: EntryPoint) -> Any:
    """Return an attribute of a module."""
    try:
        return entry.load()
    except (ImportError, AttributeError):
        raise
    except Exception as error:
        raise _does_not_run(error, Path.cwd()) from error


def _run_file(path: Path) -> ModuleType:
    """Return the module that a file of Python is, with its folder at the end of ``sys.path``.

    A file whose content has changed is run again.
    """
    name, content = f"file:{path}", path.read_bytes()  # a name that no other module has
    if name in sys.modules and sys.modules[name].__dict__["__content__"] == content:
        return sys.modules[name]
    loader = SourceFileLoader(name, str(path))  # which needs no .py in lower case
    spec: Any = spec_from_file_location(name, path, loader=loader)
    module = sys.modules[name] = module_from_spec(spec)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        exec(compile(content, path, "exec"), vars(module))
    except Exception as error:
        sys.modules.pop(name)
        raise _does_not_run(error, path.parent) from error
    vars(module)["__content__"] = content
    linecache.checkcache()
    return module


def _does_not_run(error: Exception, folder: Path) -> ParameterError:
    """Return the error for a user's code, with the place in the innermost of the user's files."""
    frames = [(frame.filename, frame.lineno) for frame in extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        frames.append((error.filename, error.lineno))
    own = [frame for frame in frames if folder in Path(frame[0]).parents] or frames[-1:]
    file, line = own[-1]
    reason = error.msg if isinstance(error, SyntaxError) else error
    place = f"{Path(file).name}, line {line}: {type(error).__name__}: {reason}"
    return ParameterError(f"policies must name code that runs, {place}")
