"""Which processes of a realm live on this machine, as its kernel knows them, whatever became of their files.

Linux lists the sockets on which processes listen by the path that each was given, also when the path, or the
whole folder, has been removed since (proc_pid_net(5), `/proc/net/unix`). So a process that nobody can reach
any more is still known. Elsewhere nothing is known here.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from robotree.vr.base.os_files import OS_FILES, OSFiles

_SOCKETS = Path("/proc/net/unix")
_LISTENS = 0x10000
"""Flag of a socket on which a process accepts connections: `__SO_ACCEPTCON` in linux/net.h."""
_FIELDS = 8
"""Num, RefCount, Protocol, Flags, Type, St, Inode, Path."""


def listening(directory: Path, system: OSFiles = OS_FILES) -> set[str]:
    """Return the names, as they were given, of the sockets in a folder on which somebody listens.

    Args:
        directory: the folder.
        system: of which it is asked.
    """
    return {path.name for path in listening_anywhere(system) if path.parent == directory}


def listening_anywhere(system: OSFiles = OS_FILES) -> list[Path]:
    """Return the paths, as they were given, of all sockets on which somebody listens, of any user."""
    found: list[Path] = []
    with contextlib.suppress(OSError):
        for line in system.text(_SOCKETS).splitlines()[1:]:
            fields = line.split(maxsplit=_FIELDS - 1)
            if len(fields) == _FIELDS and int(fields[3], 16) & _LISTENS:
                found.append(Path(fields[-1]))
    return found


def asleep(pid: int, system: OSFiles = OS_FILES) -> bool:
    """Whether a process is stopped, as by Ctrl-Z or `kill -STOP`, and so cannot answer anybody."""
    with contextlib.suppress(OSError, IndexError):
        stat = system.text(Path(f"/proc/{pid}/stat"))
        return stat.rpartition(")")[2].split()[0] == "T"  # a program's name may hold anything
    return False


def remedy(pid: int, otherwise: str, system: OSFiles = OS_FILES) -> str:
    """Return what a person can do about a process that runs and does not answer.

    Only of one that is stopped is it certain that it answers nobody. No other one is to be ended by force.

    Args:
        pid: of the process.
        otherwise: what to do if it is not stopped.
        system: of which it is asked.
    """
    return f"`kill -CONT {pid}` wakes it, `kill -9 {pid}` ends it" if asleep(pid, system) else otherwise
