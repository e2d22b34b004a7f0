"""Folders and files that no other user can enter, read or put in place for us.

What is found open to others is closed, and the caller is told so: it may have been read, or written, before.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path

from robotree.files.opening import opened, own

OTHERS = 0o077
"""Permissions of the group and of everybody."""


def private_folder(path: Path, *, strict: bool = False) -> bool:
    """See that a folder is there which only we can enter; make it, and those above it, if need be.

    Args:
        path: of the folder.
        strict: a symbolic link is refused, also one of our own, and so is a folder that lies in one which
            another user can change: that user could put another folder in its place.

    Returns:
        Whether it was open to other users until now. It is not any more.

    Raises:
        OSError: it cannot be made, is no folder, or belongs to somebody else.
    """
    _make(path)
    if strict:
        _check_parents(path)
    try:
        link = os.O_NOFOLLOW if strict else own(path)
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | link)
    except FileNotFoundError:
        if not path.is_symlink():
            raise
        reason = "it is a symbolic link to what is not there"
        raise FileNotFoundError(errno.ENOENT, reason, str(path)) from None
    except NotADirectoryError:
        reason = "it is a symbolic link, not a directory" if path.is_symlink() else "it is not a directory"
        raise NotADirectoryError(errno.ENOTDIR, reason, str(path)) from None
    try:
        return _close_to_others(folder, path, 0o700)
    finally:
        os.close(folder)


def private_file(path: Path) -> bool:
    """See that a file is there which only we can open; make an empty one if need be.

    Args:
        path: of the file.

    Returns:
        Whether it was open to other users until now. It is not any more.

    Raises:
        OSError: it cannot be made, is no ordinary file, or belongs to somebody else.
    """
    file = opened(path, os.O_RDWR | os.O_CREAT | own(path))
    try:
        return _close_to_others(file, path, 0o600)
    finally:
        os.close(file)


def own_folder(path: Path) -> None:
    """See that a folder is there into which nobody else can put anything for us; make it if need be.

    Args:
        path: of the folder; others may be able to read it.

    Raises:
        OSError: it cannot be made, is no folder, belongs to somebody else, or everybody can write into it.
    """
    _make(path, 0o755)
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | own(path))
    try:
        found = os.fstat(folder)
    finally:
        os.close(folder)
    if found.st_uid != os.geteuid():
        raise PermissionError(errno.EPERM, f"it belongs to somebody else (user {found.st_uid})", str(path))
    if found.st_mode & 0o002:
        raise PermissionError(errno.EPERM, "every user can write into it", str(path))


def shared_folder(path: Path, owner: int, mode: int, group: int = -1) -> int:
    """See that a folder of one user is there in which others meet; its owner makes or mends it.

    Args:
        path: of the folder; no part of it can be exchanged by anybody else than the owner, and root.
        owner: number of the user to whom it belongs.
        mode: its permissions.
        group: number of the group for which it is; -1: that of its owner, or whichever it has.

    Returns:
        The number of its group.

    Raises:
        OSError: it is not there and is not ours to be made, is no folder, belongs to somebody else, or others
            may do more in it than was said.
    """
    mine = os.geteuid() == owner
    if mine:
        with contextlib.suppress(FileExistsError):
            path.mkdir(mode=0o700)
    _check_parents(path, owner)
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        found = os.fstat(folder)
        if found.st_uid != owner:
            raise PermissionError(errno.EPERM, f"it belongs to user {found.st_uid}, not {owner}", str(path))
        if mine and group not in {-1, found.st_gid}:
            os.fchown(folder, -1, group)
        if mine and (stat.S_IMODE(found.st_mode) != mode or group not in {-1, found.st_gid}):
            os.fchmod(folder, mode)
        found = os.fstat(folder)
    finally:
        os.close(folder)
    if stat.S_IMODE(found.st_mode) != mode:
        reason = f"its mode is {stat.S_IMODE(found.st_mode):04o}, not {mode:04o}"
        raise PermissionError(errno.EPERM, reason, str(path))
    return found.st_gid


def _make(path: Path, mode: int = 0o700) -> None:
    """Make a folder and those above it that are missing, for us alone: XDG's base directories ask for it."""
    try:
        path.mkdir(mode=mode)
    except FileNotFoundError:
        if path.parent == path:
            raise
        _make(path.parent, mode)
        path.mkdir(mode=mode, exist_ok=True)
    except FileExistsError:
        pass
    except ValueError as error:  # a name with a zero byte
        raise OSError(errno.EINVAL, str(error), str(path)) from None


def _check_parents(path: Path, owner: int = 0) -> None:
    """Refuse a path of which another user can exchange a part.

    In a folder with the sticky bit, as /tmp has it, only the owner of an entry can rename or remove it.
    """
    for parent in path.parents:
        found = parent.stat()
        if found.st_uid not in {os.geteuid(), 0, owner}:
            raise PermissionError(
                errno.EPERM, f"it lies in {parent}, which belongs to user {found.st_uid}", str(path)
            )
        if found.st_mode & stat.S_IWOTH and not found.st_mode & stat.S_ISVTX:
            raise PermissionError(errno.EPERM, f"it lies in {parent}, where every user can write", str(path))


def _close_to_others(descriptor: int, path: Path, mode: int) -> bool:
    found = os.fstat(descriptor)
    if found.st_uid != os.geteuid():
        raise PermissionError(errno.EPERM, f"it belongs to somebody else (user {found.st_uid})", str(path))
    if not found.st_mode & OTHERS:
        return False
    os.fchmod(descriptor, mode)
    return True
