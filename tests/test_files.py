"""Files are written whole or not at all."""

import os
import stat
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

from pter_gym._internal.files import (
    check_target,
    expand_path,
    remove_leftovers,
    write_bytes_atomic,
    write_text_atomic,
)
from pter_gym.errors import ParameterError, StorageError

POSIX = pytest.mark.skipif(os.name != "posix", reason="POSIX permissions, links and limits")


def names(directory: Path) -> list[str]:
    return [path.name for path in directory.iterdir()]


# --- writing ---


def test_writes_and_replaces(tmp_path: Path):
    path = tmp_path / "result.json"
    write_text_atomic(path, "θ\n")
    assert path.read_bytes() == "θ\n".encode()
    write_bytes_atomic(str(path), b"\x00\r\n")
    assert path.read_bytes() == b"\x00\r\n"
    assert names(tmp_path) == ["result.json"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("where", ["os.fsync", "pathlib.Path.replace"])
def test_failure_leaves_the_earlier_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, error: BaseException
):
    def fail(*_args: object) -> None:
        raise error

    path = tmp_path / "result.json"
    write_text_atomic(path, "earlier")
    monkeypatch.setattr(where, fail)
    with pytest.raises(type(error)) as raised:
        write_text_atomic(path, "later")
    assert path.read_text(encoding="utf-8") == "earlier"
    assert names(tmp_path) == ["result.json"]
    if isinstance(error, OSError):
        assert isinstance(raised.value, StorageError)
    with pytest.raises(StorageError):
        write_bytes_atomic(tmp_path / "nowhere" / "result.json", b"")


@POSIX
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


@POSIX
@pytest.mark.parametrize("mode", [0o600, 0o664, 0o444])
def test_a_file_that_is_replaced_keeps_its_mode(mode: int, tmp_path: Path) -> None:
    file = tmp_path / "results.json"
    file.touch()
    file.chmod(mode)
    write_bytes_atomic(file, b"1")
    assert stat.S_IMODE(file.stat().st_mode) == mode
    assert file.read_bytes() == b"1"


def test_only_leftovers_are_removed(tmp_path: Path):
    for name in (".0123456789abcdef.tmp", ".mine.tmp", "0123456789abcdef.tmp", "result"):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert sorted(names(tmp_path)) == [".mine.tmp", "0123456789abcdef.tmp", "result"]


# --- before the work ---


@POSIX
@pytest.mark.parametrize("name", ["", b"file", 5, "a\0b", "n" * 300, "ü" * 128, "a\ud800"])
def test_names_that_no_file_can_have_are_refused(name: object) -> None:
    with pytest.raises(ParameterError, match=r"^out"):
        expand_path("out", name)  # type: ignore[arg-type]


@POSIX
@pytest.mark.parametrize("name", ["[red]", "a #?%b.db", "ü", "a\udcff", "-", "a\nb", "n" * 255])
def test_odd_names_are_names(name: str, tmp_path: Path) -> None:
    path = expand_path("out", tmp_path / name)
    check_target("out", path)
    write_bytes_atomic(path, b"1")
    assert names(tmp_path) == [name]


@settings(max_examples=25)
@given(st.text(max_size=400))
def test_any_text_is_a_path_or_refused(text: str) -> None:
    with suppress(ParameterError, FileNotFoundError, NotADirectoryError):
        expand_path("out", text).lstat()  # which raises nothing else


def test_a_target_is_a_file_in_a_folder(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    check_target("out", tmp_path / "file")
    check_target("out", tmp_path / "new")
    for wrong in ("folder", "nowhere/file", "file/below"):
        with pytest.raises(ParameterError, match=r"^out"):
            check_target("out", tmp_path / wrong)
    assert sorted(names(tmp_path)) == ["file", "folder"]
