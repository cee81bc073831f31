# pyright: standard
"""Functions whose source text is generated, with lines that tracebacks and debuggers can show."""

import hashlib
import linecache
from typing import Any


def compile_source(source: str, name: str, namespace: dict[str, Any]) -> Any:
    """Run source text and return what it defines under a name.

    Parameters
    ----------
    source
        Python statements.
    name
        The name whose value is returned.
    namespace
        Names that the source may use; gains those that it defines.
    """
    file = f"<pter_gym {name} {hashlib.sha256(source.encode()).hexdigest()[:12]}>"
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    exec(compile(source, file, "exec"), namespace)
    return namespace[name]
