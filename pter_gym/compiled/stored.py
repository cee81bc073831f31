"""Compiled kernels on the disk: numba's cache, whose files here carry a checksum.

Numba unpickles what it finds and runs it. A file that was cut short, or in which a bit has changed, would fail at every
start or break the process. Here such a file is removed and its kernel compiled again. Where nothing can be written, as
on a full disk, a kernel is compiled in memory.
"""

import hashlib
import pickle
from pathlib import Path
from typing import Any

from numba.core import caching

from pter_gym.compiled.pipeline import tell

_caching: Any = caching

DAMAGED = "stored code in {} is damaged: removed, and compiled again"
NOT_READ = "stored code in {} cannot be read ({}): it is compiled again"
NOT_WRITTEN = "compiled code cannot be stored in {} ({}): it is compiled in each process"


class DamagedError(Exception):
    """A file is not what was written."""


def sealed(content: bytes, name: str) -> bytes:
    """Return content with a checksum of it and of what it is meant for."""
    return _checksum(content, name) + content


def opened(data: bytes, name: str) -> bytes:
    """Return the content of ``sealed`` data, or raise a DamagedError."""
    size = hashlib.sha256().digest_size
    content = data[size:]
    if data[:size] != _checksum(content, name):
        raise DamagedError
    return content


def _checksum(content: bytes, name: str) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()


class _Files(_caching.IndexDataCacheFile):
    """A file for each signature, found by the hash of all that its code depends on, so there is no index."""

    def save(self, key: Any, data: Any) -> None:
        """Write what was compiled for a key."""
        path, name = self._place(key)
        with self._open_for_write(str(path)) as file:
            file.write(sealed(self._dump(data), name))

    def load(self, key: Any) -> Any:
        """Return what was compiled for a key, or None."""
        path, name = self._place(key)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            return None
        try:
            return pickle.loads(opened(data, name))
        except Exception as error:  # what foreign data raise is known to nobody
            path.unlink(missing_ok=True)
            raise DamagedError from error

    def flush(self) -> None:
        """Remove what was compiled of this kernel."""
        for path in Path(self._cache_path).glob(self._data_name_pattern.format(number=0).replace(".0.", ".*.")):
            path.unlink(missing_ok=True)

    def _place(self, key: Any) -> tuple[Path, str]:
        """Return the file for a key, and its name in full."""
        name = repr((self._version, self._source_stamp, key))
        number = int(hashlib.sha256(name.encode()).hexdigest()[:15], 16)
        return Path(self._data_path(self._data_name(number))), name


class StoredKernels(_caching.FunctionCache):
    """Numba's cache of one kernel, which no damage and no full disk breaks.

    Raises
    ------
    RuntimeError
        If there is no folder that may be written to.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        impl: Any = self._impl
        self._cache_file = _Files(self._cache_path, f"{impl.filename_base}.sealed", impl.locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for a signature, or None where there is none that can be used."""
        numbas: Any = super()
        try:
            return numbas.load_overload(sig, target_context)
        except OSError as error:
            tell(NOT_READ.format(self.cache_path, error.strerror))
        except DamagedError:
            tell(DAMAGED.format(self.cache_path))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store compiled code, if that is possible."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            tell(NOT_WRITTEN.format(self.cache_path, error.strerror))
