# pyright: standard
"""Compiled kernels on disk, for other processes: one file for each variant of a kernel.

Numba keeps an index of numbered files, which are replaced one after the other: where two processes
store at the same time, or one ends in between, the index of one names the code of the other, and
a process that loads it crashes. Here a file is named by its content, holds its own key and
checksum, and appears at once. What cannot be read is compiled again.
"""

import hashlib
import pickle
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import llvmlite
import numba
from numba.core import sigutils
from numba.core.caching import FunctionCache

from pter_gym._compiled import pipeline

_sigutils: Any = sigutils
_VERSIONS = f"{numba.__version__} {llvmlite.__version__}"
_ABANDONED = 3600.0
"""Seconds after which a file that is still being written belongs to a process that is gone."""


class StoredKernel(FunctionCache):
    """The cache of one kernel; ``stamp`` says which of its files are of these sources."""

    def __init__(self, function: Any, stamp: str) -> None:
        """Find a folder; raise RuntimeError where there is none to write to."""
        super().__init__(function)
        self._files: Any = self._cache_file
        self._form: Any = self._impl
        self._machine_and_code: Any = self._index_key
        self._folder = Path(str(cast(Any, self)._cache_path))
        qualname = function.__qualname__.replace("<locals>", "locals")
        self._stem = f"{function.__module__}.{qualname}.{sys.implementation.cache_tag}"
        self._stamp = hashlib.sha256(f"{stamp} {_VERSIONS}".encode()).hexdigest()[:16]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a stored variant, or None where it has to be compiled."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        try:
            content = self._path(key).read_bytes()
            checksum, data = content[:32], content[32:]
            if checksum != hashlib.sha256(data).digest():
                return None
            stored_key, reduced = pickle.loads(data)
            return self._form.rebuild(target_context, reduced) if stored_key == key else None
        except Exception:  # noqa: BLE001  (whatever is wrong with it, it can be compiled)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a variant where that is possible; remove those of other sources."""
        if not self._form.check_cachable(data):
            return
        key = self._key(sig, data.codegen)
        content, path = self._files._dump((key, self._form.reduce(data))), self._path(key)
        try:
            self._form.locator.ensure_cache_path()
            with self._files._open_for_write(path) as file:
                file.write(hashlib.sha256(content).digest() + content)
        except OSError as error:
            if not path.exists():  # on Windows, a file that another process reads is not replaced
                pipeline.warn(f"{pipeline.NOT_STORED} ({error.strerror})")
        self._remove_outdated()

    def _key(self, sig: Any, codegen: Any) -> Any:
        # a signature may or may not name what is returned
        arguments = str(_sigutils.normalize_signature(sig)[0])
        return arguments, self._machine_and_code(sig, codegen)[1:], self._stamp

    def _path(self, key: Any) -> Path:
        variant = hashlib.sha256(repr(key).encode()).hexdigest()[:32]
        return self._folder / f"{self._stem}.{self._stamp}.{variant}.nbc"

    def _remove_outdated(self) -> None:
        with suppress(OSError):
            for path in self._folder.glob(f"{self._stem}.*"):
                of_other_sources = not path.name.startswith(f"{self._stem}.{self._stamp}.")
                with suppress(OSError):
                    written = ".tmp." not in path.name
                    age = time.time() - path.stat().st_mtime
                    if of_other_sources if written else age > _ABANDONED:
                        path.unlink()
