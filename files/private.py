"""Folders and files that no other user can enter, read or put in place for us.

What is found open to others is closed, and the caller is told so: it may have been read, or written, before.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

from robotree.files.opening import opened, own

OTHERS = 0o077
"""Permissions of the group and of everybody."""


def private_folder(path: Path) -> bool:
    """See that a folder is there which only we can enter; make it, and those above it, if need be.

    Args:
        path: of the folder.

    Returns:
        Whether it was open to other users until now. It is not any more.

    Raises:
        OSError: it cannot be made, is no folder, or belongs to somebody else.
    """
    _make(path)
    try:
        folder = os.open(own(path), os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except NotADirectoryError:
        raise NotADirectoryError(errno.ENOTDIR, "it is not a directory", str(path)) from None
    try:
        return _close_to_others(folder, path, 0o700)
    finally:
        os.close(folder)


def private_file(path: Path, *, make: bool = True) -> bool:
    """See that a file is there which only we can open; make an empty one if need be.

    Args:
        path: of the file.
        make: whether to make one; else a missing file is an error.

    Returns:
        Whether it was open to other users until now. It is not any more.

    Raises:
        OSError: it cannot be made, is no ordinary file, or belongs to somebody else.
    """
    file = opened(own(path), os.O_RDWR | os.O_NOFOLLOW | (os.O_CREAT if make else 0))
    try:
        return _close_to_others(file, path, 0o600)
    finally:
        os.close(file)


def _make(path: Path) -> None:
    """Make a folder and those above it that are missing, for us alone: XDG's base directories ask for it."""
    try:
        path.mkdir(mode=0o700)
    except FileNotFoundError:
        if path.parent == path:
            raise
        _make(path.parent)
        path.mkdir(mode=0o700, exist_ok=True)
    except FileExistsError:
        pass
    except ValueError as error:  # a name with a zero byte
        raise OSError(errno.EINVAL, str(error), str(path)) from None


def _close_to_others(descriptor: int, path: Path, mode: int) -> bool:
    found = os.fstat(descriptor)
    if found.st_uid != os.geteuid():
        raise PermissionError(errno.EPERM, f"it belongs to somebody else (user {found.st_uid})", str(path))
    if not found.st_mode & OTHERS:
        return False
    os.fchmod(descriptor, mode)
    return True
