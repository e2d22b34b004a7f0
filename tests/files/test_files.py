"""What somebody else has prepared neither holds us up nor fills the memory, and no link leads us astray."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from robotree.files import (
    expect_own,
    opened,
    opened_own,
    overwrite,
    own_folder,
    private_file,
    private_folder,
    read,
    replace,
    text,
)
from robotree.files.database import OwnedDatabase

root_only = pytest.mark.skipif(os.geteuid() != 0, reason="only root can play a second user")
NOBODY = 65534


def give_away(path: Path) -> None:
    os.chown(path, NOBODY, NOBODY, follow_symlinks=False)


def mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


def bound_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


PREPARED: dict[str, tuple[Callable[[Path], object], str]] = {
    "a FIFO": (os.mkfifo, "it is a FIFO, not a file"),
    "a folder": (Path.mkdir, "it is a folder, not a file"),
    "/dev/zero": (lambda path: path.symlink_to("/dev/zero"), "it is a device, not a file"),
    "a socket": (bound_socket, "No such device or address"),
    "a file without end": (lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_RDWR), 10**12), "larger"),
    "no text": (lambda path: path.write_bytes(b"\xff\xfe"), "it is not UTF-8 text"),
    "nothing": (lambda _: None, "No such file"),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("prepared", PREPARED)
def test_what_is_no_ordinary_file_is_an_error_at_once(tmp_path: Path, prepared: str) -> None:
    prepare, reason = PREPARED[prepared]
    prepare(tmp_path / "x")
    with pytest.raises(OSError, match=reason) as refused:
        text(tmp_path / "x", 1000)
    assert refused.value.strerror
    assert refused.value.filename == str(tmp_path / "x")


def test_an_ordinary_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"one\r\ntwo\rthree\n")
    assert read(path, 15) == b"one\r\ntwo\rthree\n"
    assert text(path, 15) == path.read_text() == "one\ntwo\nthree\n"
    (tmp_path / "marked").write_bytes(b"\xef\xbb\xbfone")  # as some editors save UTF-8
    assert text(tmp_path / "marked", 15) == "one"
    with pytest.raises(OSError, match="larger than 14 bytes"):
        read(path, 14)
    for name in ("a\0b", "\ud800"):
        with pytest.raises(OSError, match=r"zero byte|encoded"):
            read(tmp_path / name, 1)


def test_no_child_inherits_what_is_opened(tmp_path: Path) -> None:
    descriptor = opened(tmp_path / "x", os.O_RDWR | os.O_CREAT)
    assert not os.get_inheritable(descriptor)
    os.close(descriptor)


def test_a_file_is_overwritten_and_a_fifo_that_nobody_reads_is_an_error(tmp_path: Path) -> None:
    overwrite(tmp_path / "x", b"longer")
    overwrite(tmp_path / "x", b"short")
    assert (tmp_path / "x").read_bytes() == b"short"
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(OSError, match="No such device"):
        overwrite(tmp_path / "fifo", b"x")
    reader = os.open(tmp_path / "fifo", os.O_RDONLY | os.O_NONBLOCK)
    overwrite(tmp_path / "fifo", b"heard")
    assert os.read(reader, 9) == b"heard"
    os.close(reader)


def test_what_a_shell_hands_out_as_a_file_can_be_written() -> None:
    """`robotree look cell /dev/stdout | …`: a link of the system to a pipe."""
    code = (
        "from pathlib import Path; from robotree.files import overwrite; overwrite(Path('/dev/stdout'), b'x')"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout == b"x"


def test_private_means_0700_and_0600_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        assert not private_folder(tmp_path / "a" / "b" / "c")
        assert not private_file(tmp_path / "a" / "file")
    finally:
        os.umask(before)
    assert [mode(tmp_path / name) for name in ("a", "a/b", "a/b/c", "a/file")] == [0o700] * 3 + [0o600]


def test_what_is_open_to_others_is_closed_and_that_is_told(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir(mode=0o755)
    (tmp_path / "file").write_text("kept")
    (tmp_path / "file").chmod(0o644)
    assert private_folder(tmp_path / "folder")
    assert private_file(tmp_path / "file")
    assert (mode(tmp_path / "folder"), mode(tmp_path / "file")) == (0o700, 0o600)
    assert not private_folder(tmp_path / "folder")
    assert not private_file(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.timeout(60)
def test_a_private_place_is_what_it_should_be(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    for path, reason in ((tmp_path / "fifo", "it is a FIFO"), (Path("/dev/zero"), "it is a device")):
        with pytest.raises(OSError, match=reason):
            private_file(path)
        with pytest.raises(OSError, match="it is not a directory"):
            private_folder(path)


def test_a_link_of_our_own_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "dangling").symlink_to("real/new")
    private_folder(tmp_path / "link")
    private_file(tmp_path / "dangling")
    assert (mode(tmp_path / "real"), mode(tmp_path / "real/new")) == (0o700, 0o600)


def test_a_folder_of_our_own_keeps_its_permissions_unless_everybody_can_write(tmp_path: Path) -> None:
    own_folder(tmp_path / "a" / "b")
    (tmp_path / "a" / "b").chmod(0o750)
    own_folder(tmp_path / "a" / "b")
    assert mode(tmp_path / "a" / "b") == 0o750
    (tmp_path / "a" / "b").chmod(0o777)
    with pytest.raises(PermissionError, match="every user can write"):
        own_folder(tmp_path / "a" / "b")


@root_only
def test_nothing_that_belongs_to_another_user_becomes_ours(tmp_path: Path) -> None:
    ours = tmp_path / "precious"
    ours.write_text("precious")
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    for name in ("folder", "file"):
        give_away(tmp_path / name)
    for use in (private_folder, own_folder):
        with pytest.raises(PermissionError, match="belongs to somebody else"):
            use(tmp_path / "folder")
    with pytest.raises(PermissionError, match="belongs to somebody else"):
        private_file(tmp_path / "file")
    (tmp_path / "link").symlink_to(ours)
    give_away(tmp_path / "link")
    for astray in (lambda path: overwrite(path, b"gone"), private_file, private_folder):
        with pytest.raises(PermissionError, match=f"a link that user {NOBODY} made"):
            astray(tmp_path / "link")
    assert ours.read_text() == "precious"


KEPT: dict[str, tuple[Callable[[Path], object], str]] = {
    "a FIFO": (os.mkfifo, "it is a FIFO, not a file"),
    "a folder": (Path.mkdir, "it is a folder, not a file"),
    "a link of our own": (lambda path: path.symlink_to(path.parent / "precious"), "it is a symbolic link"),
    "a link to nothing": (lambda path: path.symlink_to("nowhere"), "it is a symbolic link, not a file"),
    "a socket": (bound_socket, "it is a socket, not a file"),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("flags", [os.O_RDONLY, os.O_WRONLY | os.O_CREAT, os.O_RDWR | os.O_CREAT])
@pytest.mark.parametrize("prepared", KEPT)
def test_what_a_program_keeps_for_itself_is_never_something_else(
    tmp_path: Path, prepared: str, flags: int
) -> None:
    prepare, reason = KEPT[prepared]
    (tmp_path / "precious").write_text("kept")
    prepare(tmp_path / "x")
    with pytest.raises(OSError, match=reason):
        opened_own(tmp_path / "x", flags)
    with pytest.raises(OSError, match=reason):
        expect_own(tmp_path / "x")
    assert (tmp_path / "precious").read_text() == "kept"
    assert not (tmp_path / "nowhere").exists()


@root_only
def test_what_a_program_keeps_for_itself_is_no_file_of_another_user(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("theirs")
    give_away(tmp_path / "x")
    for look in (opened_own, expect_own):
        with pytest.raises(PermissionError, match=f"it belongs to somebody else \\(user {NOBODY}\\)"):
            look(tmp_path / "x")


def test_what_a_program_keeps_for_itself_may_be_missing(tmp_path: Path) -> None:
    expect_own(tmp_path / "x")
    os.close(opened_own(tmp_path / "x", os.O_CREAT | os.O_WRONLY))
    expect_own(tmp_path / "x")
    assert mode(tmp_path / "x") == 0o600


def test_a_file_is_replaced_whole_or_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x"
    replace(path, b"first")
    path.chmod(0o640)
    (tmp_path / "link").symlink_to(path)
    replace(tmp_path / "link", b"second")
    assert (path.read_bytes(), mode(path), (tmp_path / "link").is_symlink()) == (b"second", 0o640, True)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        replace(path, b"third")
    assert path.read_bytes() == b"second"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["link", "x"]


def test_what_is_no_file_is_written_to(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x")
    with pytest.raises(OSError, match="No such device or address"):
        replace(tmp_path / "x", b"nobody reads it")
    replace(Path("/dev/null"), b"gone")
    assert Path("/dev/null").is_char_device()


KILLED = """
import os, pathlib, signal, sys
from robotree.files import replace
os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)
replace(pathlib.Path(sys.argv[1]), b"secret", 0o600)
"""


def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path: Path) -> None:
    path = tmp_path / "x"
    for _ in range(2):
        subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    assert len(list(tmp_path.iterdir())) == 1
    replace(path, b"whole", 0o600)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"whole"


def test_two_writers_at_once_do_not_mix(tmp_path: Path) -> None:
    path = tmp_path / "x"
    contents = {letter * 100_000 for letter in (b"a", b"b", b"c", b"d")}

    def write(content: bytes) -> None:
        for _ in range(20):
            replace(path, content)
            assert path.read_bytes() in contents

    with ThreadPoolExecutor() as writers:
        list(writers.map(write, contents))
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("planted", ["link", "fifo"])
def test_a_draft_is_written_through_nothing_that_stands_there(tmp_path: Path, planted: str) -> None:
    (tmp_path / "precious").write_text("kept")
    draft = tmp_path / f".x.new{os.geteuid()}"
    draft.symlink_to("precious") if planted == "link" else os.mkfifo(draft)
    with pytest.raises(OSError, match="not a file"):
        replace(tmp_path / "x", b"secret")
    assert (tmp_path / "precious").read_text() == "kept"


@pytest.mark.parametrize("stands", ["link", "fifo"])
def test_with_a_mode_the_name_itself_is_replaced(tmp_path: Path, stands: str) -> None:
    (tmp_path / "precious").write_text("kept")
    path = tmp_path / "key"
    path.symlink_to("precious") if stands == "link" else os.mkfifo(path)
    replace(path, b"secret", 0o600)
    assert (path.read_bytes(), mode(path), path.is_symlink()) == (b"secret", 0o600, False)
    assert (tmp_path / "precious").read_text() == "kept"


# -- a database that one process owns: what a block writes is kept whole, or not at all ------------


def test_a_block_that_fails_has_written_nothing_and_the_next_one_can_begin(tmp_path: Path) -> None:
    file = OwnedDatabase(
        tmp_path / "numbers.db",
        "CREATE TABLE number (value INTEGER);",
        mark=1,
        version=1,
        unusable=OSError,
        damaged=OSError,
        full=OSError,
    )

    def write(value: int) -> None:
        with file.transaction():
            file.execute("INSERT INTO number VALUES (?)", (value,))
            if value == 1:
                raise ValueError("on purpose")

    with pytest.raises(ValueError, match="on purpose"):
        write(1)
    write(2)
    assert [*file.execute("SELECT value FROM number")] == [(2,)]
    file.close()
