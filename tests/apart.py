"""A machine for one test alone: mounts and sockets that nobody else sees, where the system allows it.

    python -m tests.apart MODULE:FUNCTION [--on FOLDER=SIZE …]

runs a coroutine function apart: with a network of its own, in which no process listens yet, and with an empty
file system of its own on each folder, as large as is said (`/tmp=1m`). So it can fill them, and `stop
--everywhere` finds the realms of this function alone. The exit code is `CANNOT` where the system allows none
of this.
"""

from __future__ import annotations

import argparse
import asyncio
import ctypes
import errno
import fcntl
import functools
import importlib
import os
import socket
import struct
import subprocess
import sys
from pathlib import Path

from tests.command_line import ran

CANNOT = 77
"""Exit code where the system allows no namespaces, as automake's tests say that they were skipped."""
ROOT = Path(__file__).parents[1]

_NEW_MOUNTS, _NEW_USER, _NEW_NETWORK = 0x00020000, 0x10000000, 0x40000000
"""CLONE_NEWNS, CLONE_NEWUSER, CLONE_NEWNET: unshare(2)."""
_PRIVATE, _RECURSIVE = 1 << 18, 1 << 14
"""MS_PRIVATE, MS_REC: mount(2)."""
_NOSUID, _NODEV = 2, 4
_LAZILY = 2
"""MNT_DETACH: umount2(2)."""
_GET_FLAGS, _SET_FLAGS, _UP = 0x8913, 0x8914, 1
"""SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP: netdevice(7)."""
_LIBC = ctypes.CDLL(None, use_errno=True)


def enter(*, network: bool) -> None:
    """Give this process mounts of its own, for good; it must have one thread only.

    A user without rights becomes, with the same id, the one user of a user namespace.

    Args:
        network: whether it gets a network of its own, too, with a loopback interface.

    Raises:
        OSError: the system does not allow it.
    """
    wanted = _NEW_MOUNTS | (_NEW_NETWORK if network else 0)
    user, group = os.geteuid(), os.getegid()
    try:
        _call("unshare", wanted)
    except PermissionError:
        _call("unshare", wanted | _NEW_USER)
        for name, line in (
            ("setgroups", "deny"),
            ("uid_map", f"{user} {user} 1"),
            ("gid_map", f"{group} {group} 1"),
        ):
            Path("/proc/self", name).write_text(line)
    _call("mount", None, b"/", None, _PRIVATE | _RECURSIVE, None)
    if network:
        _raise_loopback()


def mount(folder: Path, size: str) -> None:
    """Put an empty file system on a folder.

    Args:
        folder: in mounts of our own, see `enter`.
        size: of it, such as `1m`.

    Raises:
        OSError: it cannot be mounted.
    """
    options = f"size={size},mode={folder.stat().st_mode & 0o7777:o}".encode()
    _call("mount", b"tmpfs", os.fsencode(folder), b"tmpfs", _NOSUID | _NODEV, options)


def unmount(folder: Path) -> None:
    """Take away what `mount` has put on a folder, as soon as nobody uses it any more.

    Raises:
        OSError: nothing is mounted there.
    """
    _call("umount2", os.fsencode(folder), _LAZILY)


def fill(folder: Path, name: str = "full") -> Path:
    """Fill the file system of a folder up to its last byte. Returns: the file that does it."""
    path = folder / name
    with path.open("ab", buffering=0) as file:
        for size in (1 << 16, 1 << 12, 1):
            try:
                while file.write(b"\0" * size):
                    pass
            except OSError as error:
                if error.errno != errno.ENOSPC:
                    raise
    return path


@functools.cache
def reason() -> str:
    """Return why nothing can be run apart here; empty: it can."""
    done = run("tests.apart:nothing", "/tmp=1m")  # noqa: S108 # it is mounted on, not used
    return "" if done.returncode == 0 else done.stderr.strip() or f"it ended with {done.returncode}"


def run(what: str, *mounts: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a coroutine function apart, in a process of its own, to its end.

    Args:
        what: MODULE:FUNCTION.
        mounts: FOLDER=SIZE.
        environment: variables beside those of this process.
    """
    return ran(
        [sys.executable, "-m", "tests.apart", what, *(word for one in mounts for word in ("--on", one))],
        cwd=ROOT,
        within=100,
        env={**os.environ, **environment},
    )


async def nothing() -> None:
    """Do nothing: whether a process can be apart shows before."""


def main() -> int:
    """Enter, mount, and run."""
    parser = argparse.ArgumentParser(prog="python -m tests.apart", description=__doc__)
    parser.add_argument("what")
    parser.add_argument("--on", action="append", default=[])
    given = parser.parse_args()
    try:
        enter(network=True)
        for one in given.on:
            folder, _, size = one.rpartition("=")
            mount(Path(folder), size)
    except OSError as error:
        sys.stderr.write(f"no file system of its own can be mounted here: {error.strerror}\n")
        return CANNOT
    module, _, function = given.what.partition(":")
    asyncio.run(getattr(importlib.import_module(module), function)())
    return 0


def _call(name: str, *arguments: object) -> None:
    if getattr(_LIBC, name)(*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), name)


def _raise_loopback() -> None:
    with socket.socket() as any_socket:
        request = struct.pack("16sH22x", b"lo", 0)
        flags = struct.unpack("16sH22x", fcntl.ioctl(any_socket, _GET_FLAGS, request))[1]
        fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sH22x", b"lo", flags | _UP))


if __name__ == "__main__":
    raise SystemExit(main())
