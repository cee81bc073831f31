"""Files are written whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from pter_gym.internal.files import write_bytes_atomic, write_text_atomic


def names(directory: Path) -> list[str]:
    return [path.name for path in directory.iterdir()]


def test_writes_and_replaces(tmp_path: Path):
    path = tmp_path / "result.json"
    write_text_atomic(path, "θ\n")
    assert path.read_bytes() == "θ\n".encode()
    write_bytes_atomic(str(path), b"\x00\r\n")
    assert path.read_bytes() == b"\x00\r\n"
    assert names(tmp_path) == ["result.json"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("where", ["os.fsync", "pathlib.Path.replace"])
def test_failure_leaves_the_earlier_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, error: type[BaseException]
):
    def fail(*_args: object) -> None:
        raise error

    path = tmp_path / "result.json"
    write_text_atomic(path, "earlier")
    monkeypatch.setattr(where, fail)
    with pytest.raises(error):
        write_text_atomic(path, "later")
    assert path.read_text(encoding="utf-8") == "earlier"
    assert names(tmp_path) == ["result.json"]


def test_missing_directory_is_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        write_bytes_atomic(tmp_path / "nowhere" / "result.json", b"")
    assert names(tmp_path) == []


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions and links")
def test_permissions_follow_the_umask_and_links_are_kept(tmp_path: Path):
    plain = tmp_path / "plain"
    plain.touch()
    link = tmp_path / "latest"
    link.symlink_to("result")
    write_bytes_atomic(link, b"1")
    result = tmp_path / "result"
    assert link.is_symlink()
    assert result.read_bytes() == b"1"
    assert stat.S_IMODE(result.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_longest_file_name(tmp_path: Path):
    path = tmp_path / ("n" * 255)
    write_bytes_atomic(path, b"1")
    assert path.read_bytes() == b"1"
