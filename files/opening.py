"""Opening a file by its name without waiting for anybody, and reading no more of it than it may have."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
from collections.abc import Generator
from pathlib import Path

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def opened(path: Path, flags: int = os.O_RDONLY, mode: int = 0o600) -> int:
    """Open an ordinary file. Does not wait, whatever the name leads to.

    Args:
        path: of the file.
        flags: as for `os.open`.
        mode: permissions of a file that `os.O_CREAT` makes.

    Returns:
        The descriptor; no child process inherits it.

    Raises:
        OSError: it cannot be opened, or is no ordinary file; `strerror` says what it is.
    """
    descriptor = _open(path, flags, mode)
    found = os.fstat(descriptor).st_mode
    if stat.S_ISREG(found):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, f"it is {_kind(found)}, not a file", str(path))


def opened_own(path: Path, flags: int = os.O_RDONLY) -> int:
    """Open an ordinary file that this program keeps for itself: no link is followed, also none of our own.

    Args:
        path: of the file.
        flags: as for `os.open`; a new file is for this user alone.

    Returns:
        The descriptor; no child process inherits it.

    Raises:
        OSError: it cannot be opened, is no ordinary file, or belongs to another user; `strerror` says which.
    """
    try:
        descriptor = opened(path, flags | os.O_NOFOLLOW)
    except OSError as error:
        raise _explained(path) or error from None
    if (owner := os.fstat(descriptor).st_uid) == os.geteuid():
        return descriptor
    os.close(descriptor)
    raise _belongs_to(owner, path)


def expect_own(path: Path) -> None:
    """Hold that a file is missing, or an ordinary one of this user: who opens it by its name is safe then.

    Raises:
        OSError: it is something else; `strerror` says what.
    """
    if (error := _explained(path)) is not None:
        raise error


def _explained(path: Path) -> OSError | None:
    """Return what is wrong with a file that should be ours; None: nothing, or it is not there."""
    try:
        found = path.lstat()
    except OSError:
        return None
    if stat.S_ISLNK(found.st_mode):
        return OSError(errno.ELOOP, "it is a symbolic link, not a file", str(path))
    if not stat.S_ISREG(found.st_mode):
        return OSError(errno.EINVAL, f"it is {_kind(found.st_mode)}, not a file", str(path))
    return None if found.st_uid == os.geteuid() else _belongs_to(found.st_uid, path)


def _belongs_to(user: int, path: Path) -> OSError:
    return PermissionError(errno.EPERM, f"it belongs to somebody else (user {user})", str(path))


def read(path: Path, most: int) -> bytes:
    """Read an ordinary file whole.

    Args:
        path: of the file.
        most: [bytes] that it may have. What `stat` says of a size is not believed: for /dev/zero it is 0.

    Returns:
        Its content.

    Raises:
        OSError: it cannot be read, is no ordinary file, or is larger.
    """
    with os.fdopen(opened(path), "rb") as file:
        data = file.read(most + 1) or b""
    if len(data) > most:
        size = f"{most // 1000} kB" if most >= 1000 else f"{most} bytes"
        raise OSError(errno.EFBIG, f"it is larger than {size}", str(path))
    return data


def text(path: Path, most: int) -> str:
    """Read an ordinary file of UTF-8 text whole; line ends are read as Python's own reading does it.

    Args:
        path: of the file.
        most: [bytes] that it may have.

    Returns:
        Its text.

    Raises:
        OSError: it cannot be read, is no ordinary file, is larger, or is no UTF-8 text.
    """
    try:
        decoded = read(path, most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "it is not UTF-8 text", str(path)) from None
    return decoded.replace("\r\n", "\n").replace("\r", "\n")


def overwrite(path: Path, data: bytes) -> None:
    """Write a file, new or in place of the old content. A FIFO that nobody reads is an error at once.

    Args:
        path: of the file; also a device or a FIFO, such as /dev/stdout.
        data: its new content.

    Raises:
        OSError: it cannot be written, or another user made the link that stands there.
    """
    descriptor = _open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | own(path), 0o666)
    os.set_blocking(descriptor, True)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)


def replace(path: Path, data: bytes, mode: int | None = None) -> None:
    """Write a file so that who reads it, also after a crash, finds the old content or the new one.

    Args:
        path: of the file. Without a mode a link is followed, and a device or a FIFO, such as /dev/stdout, is
            written to. With a mode it is a file that this program keeps for itself, such as a private key:
            whatever has the name is replaced by an ordinary file, and nothing is written through a link.
        data: its new content.
        mode: its permissions; None: those that it has, or that each new file of this user gets.

    Raises:
        OSError: it cannot be written, or another user made the link that stands there; the old one stays.
    """
    if mode is None:
        if path.exists() and not path.is_file():
            overwrite(path, data)
            return
        own(path)
        path = path.resolve()  # a link stays one
        if path.exists():
            mode = path.stat().st_mode & 0o7777
    new = path.with_name(f".{path.name}.new{os.geteuid()}")
    with os.fdopen(_draft(new, 0o666 if mode is None else mode), "wb") as file:
        try:
            file.write(data)
            file.flush()
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())
            new.replace(path)
        except BaseException:
            new.unlink(missing_ok=True)
            raise


def _draft(path: Path, mode: int) -> int:
    """Open a new file that only its writer renames or removes, for it is locked; it waits for another writer.

    One that a killed writer has left is locked by nobody any more, and removed.
    """
    while True:
        try:
            draft, fresh = _open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), True
        except FileExistsError:
            try:
                draft, fresh = opened_own(path), False
            except FileNotFoundError:  # its writer is done
                continue
        try:
            fcntl.flock(draft, fcntl.LOCK_EX)
            if _leads_to(path, draft):
                if fresh:
                    return draft
                path.unlink()
        except BaseException:
            os.close(draft)
            raise
        os.close(draft)


def _leads_to(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.lstat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


@contextlib.contextmanager
def alone(path: Path) -> Generator[None]:
    """Keep out all others who ask for the same, in any process or thread, until the block ends; it waits.

    Args:
        path: of an empty file that stands for what is kept, in a folder of ours; it is made if need be.

    Raises:
        OSError: it cannot be made.
    """
    lock = opened(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder survive a loss of power: that of a new file is not kept with its content.

    Raises:
        OSError: the folder cannot be opened, or its file system cannot do it.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def own(path: Path) -> int:
    """Return the flag to open a name with, so that no other user decides where it leads.

    A link that stands in a folder like /tmp may lead to any of our own files. Links of our own, and of root,
    are followed; where there is none now, none is followed that comes meanwhile.

    Raises:
        OSError: the last part of the path is a symbolic link that another user made.
    """
    try:
        found = path.lstat()
    except FileNotFoundError:
        return os.O_NOFOLLOW
    except ValueError:
        raise _no_name(path) from None
    if not stat.S_ISLNK(found.st_mode):
        return os.O_NOFOLLOW
    if found.st_uid not in {os.geteuid(), 0}:
        raise PermissionError(errno.EPERM, f"it is a link that user {found.st_uid} made", str(path))
    return 0


def _open(path: Path, flags: int, mode: int) -> int:
    try:
        return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC, mode)
    except ValueError:
        raise _no_name(path) from None


def _no_name(path: Path) -> OSError:
    """Make the error for a name that no file can have; how Python words it changes with its version."""
    zero = "\0" in str(path)
    reason = "its name contains a zero byte" if zero else "its name cannot be encoded by the file system"
    return OSError(errno.EINVAL, reason, str(path))


def _kind(mode: int) -> str:
    return next((name for test, name in _KINDS if test(mode)), "something else")
