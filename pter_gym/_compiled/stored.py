"""Compiled kernels on the disk: numba's cache, whose files here carry a checksum.

Numba unpickles what it finds and runs it: a file that was cut short, or in which a bit has changed, would fail at every
start or crash the process. Here whatever is wrong with a file, its kernel is compiled again. Where nothing can be
written, as on a full disk, a kernel is compiled in memory.
"""

import hashlib
import pickle
from pathlib import Path
from typing import Any

from numba.core import caching

from pter_gym._compiled.pipeline import tell

_caching: Any = caching

NOT_READ = "stored code in {} is damaged or cannot be read ({}): it is compiled again"
NOT_WRITTEN = "compiled code cannot be stored in {} ({}): it is compiled in each process"


class _Files(_caching.IndexDataCacheFile):
    """A file for each signature, found by the hash of all that its code depends on, so there is no index."""

    def save(self, key: Any, data: Any) -> None:
        """Write what was compiled for a key."""
        path, name = self._place(key)
        content = self._dump(data)
        with self._open_for_write(str(path)) as file:
            file.write(_checksum(name, content) + content)

    def load(self, key: Any) -> Any:
        """Return what was compiled for a key, or None."""
        path, name = self._place(key)
        if not path.exists():
            return None
        data = path.read_bytes()
        size = hashlib.sha256().digest_size
        if data[:size] != _checksum(name, data[size:]):
            raise ValueError("wrong checksum")
        return pickle.loads(data[size:])

    def _place(self, key: Any) -> tuple[Path, str]:
        """Return the file for a key, and its name in full."""
        name = repr((self._version, key))
        number = int(hashlib.sha256(name.encode()).hexdigest()[:15], 16)
        return Path(self._data_path(self._data_name(number))), name


def _checksum(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()


class StoredKernels(_caching.FunctionCache):
    """Numba's cache of one kernel, which survives damaged files and full disks.

    Raises
    ------
    RuntimeError
        If there is no folder that may be written to.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        impl: Any = self._impl
        self._cache_file = _Files(self._cache_path, impl.filename_base, impl.locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for a signature, or None where there is none that can be used."""
        numbas: Any = super()
        try:
            return numbas.load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - unpickling can raise anything
            tell(NOT_READ.format(self.cache_path, error))
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store compiled code, if that is possible."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            tell(NOT_WRITTEN.format(self.cache_path, error.strerror))
