"""Write files whole or not at all."""

import os
import secrets
from pathlib import Path


def write_bytes_atomic(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file whole or not at all: nobody ever sees a part of it.

    The data go to a temporary file in the same directory, to the disk, and only then to their name. When anything fails
    or interrupts, an earlier file of that name stays as it was and the temporary file is removed.

    Parameters
    ----------
    path
        File to write or replace; its directory must exist. A symbolic link is followed.
    data
        The whole content.
    """
    target = Path(path).resolve()
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text_atomic(path: str | os.PathLike[str], text: str) -> None:
    """Write text in UTF-8, whole or not at all; see ``write_bytes_atomic``. Line ends stay as they are."""
    write_bytes_atomic(path, text.encode())
