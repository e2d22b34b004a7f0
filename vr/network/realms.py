"""Where the realms of this user lie on this machine, which processes live there, and what each has written.

The reading side of `rendezvous.py`. It imports little, makes nothing and asks nobody, so that a stop can
begin here before anything else is loaded (`lean_stop.py`).
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import zlib
from collections import Counter
from pathlib import Path

from robotree.files.private import OTHERS
from robotree.vr.base.os_files import OS_FILES, OSFiles

TYPE_CHECKING = False
"""As `typing.TYPE_CHECKING`, which would take a while to import."""

if TYPE_CHECKING:
    from robotree.vr.base.system import Socket

REALM_VARIABLE = "ROBOTREE_REALM"
DEFAULT_REALM = "default"

LOGIN, SHARED = Path("/run/user"), Path("/tmp")  # noqa: S108 # whose folder it is, is checked
"""Where private folders of users lie: those of login sessions, and those of everybody else."""

SHARES = "robotree-shared-"
"""Begin of the name of the folder below `SHARED` with the realms that a user shares with others of the
machine; the user's number follows."""

LONGEST_LIST = 1 << 22
"""[bytes] of a list of keys that are read; a longer file is not one of ours."""

LOOKS = 3
"""Readings of a list of keys before it is called damaged: a reading can meet the seal half written."""

_SEAL = re.compile(rb"(\d{10}) ([0-9a-f]{8})\n")

SHARED_BY = "shared-by"
"""File in what a user keeps of a realm: the number of the user who shares it."""

SOCKET, HELD = ".sock", ".held"
TAG = re.compile(r"\d{1,10}-[0-9a-f]{8}")
_ENTRY = re.compile(rf"({TAG.pattern}){re.escape(SOCKET)}")
_KEY = re.compile(r"[!-~]+")
"""The form of a key: printable, and without spaces."""
_ROBOT = re.compile(r"robot/([A-Za-z0-9][A-Za-z0-9_-]{0,63})/[^/\s]+")
_AGENT = re.compile(r"([a-z]+)/([A-Za-z0-9][A-Za-z0-9_-]{0,63})/[^/\s]+")
_EACH = "*"
"""In a key: any name, or any incarnation."""


def runtime_directory() -> Path:
    """Return where a new realm of this user lies: private, and gone after a restart of the machine.

    It depends on nothing but `$XDG_RUNTIME_DIR` and the user. What `tempfile` chooses also depends on which
    folders are full, so that two processes could choose two. Links are resolved: the system remembers sockets
    by the path as it was given, see `listening`.
    """
    if private := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(private).resolve() / "robotree"
    return SHARED.resolve() / f"robotree-{os.geteuid()}"


def state_home() -> Path:
    """Return the folder of what realms keep over a restart of the machine; looking makes nothing."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "robotree"


def realm_folder(realm: str) -> Path:
    """Return the folder of a realm: where its processes meet already, else the one below `runtime_directory`.

    A service of the system and a login session of the same user have different runtime directories. Both are
    looked at, so that a process of one joins the realm of the other. Where `$XDG_RUNTIME_DIR` names a third
    folder, the user wants realms apart.
    """
    if (owner := shared_by(realm)) is not None:
        return shares_of(owner) / realm
    own = runtime_directory() / realm
    other = _twin(own)
    return other if other and not inhabited(own) and inhabited(other) else own


def shares_of(owner: int) -> Path:
    """Return where the realms lie that a user shares with others of this machine."""
    return SHARED.resolve() / f"{SHARES}{owner}"


def shared_by(realm: str) -> int | None:
    """Return the user whose shared realm this user means by a name; None: a realm of its own.

    Each user says so once (`robotree realm join NAME@USER`), so that nobody is led into a realm of others.
    """
    try:
        return int((state_home() / realm / SHARED_BY).read_bytes()[:20])
    except (OSError, ValueError):
        return None


def owner_of(directory: Path) -> int | None:
    """Return the user who shares the realm of a folder; None: it is private."""
    name = directory.parent.name
    number = name.removeprefix(SHARES)
    return int(number) if name != number and number.isdecimal() else None


def leads_to(line: Socket, directory: Path, tag: str, system: OSFiles = OS_FILES) -> bool:
    """Whether a connection leads to the process that has a tag, as the kernel says.

    In a shared realm another user could have put a link there, which leads to a socket of ours in another
    realm. The kernel knows the name under which a socket was made, whatever leads to it.

    Args:
        line: that was dialed.
        directory: in which the entry is.
        tag: of the process.
        system: of the connection.
    """
    process, user = system.far_end(line)
    if owner_of(directory) is None:
        return user == system.user()
    return process == process_of(tag) and line.getpeername() == str(directory / f".{tag}")


def places(directory: Path, system: OSFiles = OS_FILES) -> list[Path]:
    """Return the folders in which the processes of one realm meet: this one and its twin.

    A service and a process of a login session that found a realm at the same moment found it in two folders.
    All look into both, so that it is one realm nevertheless.

    Args:
        directory: of the realm.
        system: where it lies.
    """
    other = _twin(directory)
    twins = other and _private(other.parent, system) and _private(other, system)
    return [directory, other] if other and twins else [directory]


def common_folder(directory: Path) -> Path:
    """Return a folder that all processes of a realm know, in whichever of its two folders they are.

    Args:
        directory: of the realm; one without a twin is known to all of them.
    """
    return SHARED.resolve() / f"robotree-{os.geteuid()}" if _twin(directory) else directory


def all_realms() -> list[Path]:
    """Return the folders of all realms of this user in which a process lives, by the name of the realm.

    Of a realm that lies in two (see `places`) it is one of them.
    The kernel knows those that lie below another runtime directory than ours; see `listening`.
    """
    found, own = _known_to_the_kernel(), runtime_directory()
    with contextlib.suppress(OSError):
        found |= {path for path in own.iterdir() if _has_members(path)}
    with contextlib.suppress(OSError):
        joined = (path.name for path in state_home().iterdir() if (path / SHARED_BY).exists())
        found |= {path for path in map(realm_folder, joined) if _has_members(path)}
    found -= {other for path in found for other in places(path)[1:] if path < other}
    return sorted(found, key=lambda path: (path.name, path))


def members(directory: Path, system: OSFiles = OS_FILES) -> list[str]:
    """Return the tags of all processes with an entry in a realm's folder, also of those that have ended."""
    with contextlib.suppress(OSError):
        return sorted(entry[1] for name in system.names(directory) if (entry := _ENTRY.fullmatch(name)))
    return []


def inhabited(directory: Path) -> bool:
    """Whether a process of ours lives in the realm of a folder, also after the folder has been removed."""
    return _has_members(directory) or directory in _known_to_the_kernel()


def process_of(tag: str) -> int:
    """Return the id of the process that has a tag."""
    return int(tag.partition("-")[0])


def seal(size: int, checksum: int) -> bytes:
    """Return the first line of a list of keys, which proves the rest: its length and checksum.

    It has the same length for all lists, so that it can be replaced in place after each line that is added.

    Args:
        size: [bytes] of the lines behind it.
        checksum: CRC-32 of them.
    """
    return b"%010d %08x\n" % (size, checksum)


def sealed(lines: bytes) -> bytes:
    """Return a list of keys, as it lies in its file.

    Args:
        lines: one key each; a line that begins with - takes one back.
    """
    return seal(len(lines), zlib.crc32(lines)) + lines


def keys_of(directory: Path, tag: str, system: OSFiles = OS_FILES) -> list[str] | None:
    """Return the keys under which a process is present, as it has written them down.

    None: that cannot be read here, or not any more, or it is damaged; the process mends it at its next beat.
    A list that was cut anywhere is damaged, also an empty file.
    """
    for _ in range(LOOKS):
        written = _content(directory, tag, system)
        if written is None:
            return None
        lines = _proven(written)
        if lines is not None:
            keys = _counted(lines)
            sound = min(keys.values(), default=0) >= 0 and all(map(_KEY.fullmatch, keys))
            return list(keys.elements()) if sound else None
    return None


def to_be_asked(directory: Path, tag: str, name: str, system: OSFiles = OS_FILES) -> list[str]:
    """Return the keys under which robots of a process are asked, as it has written them down.

    If its list is damaged, or cannot be read, it is one pattern: the process knows which robots are meant.

    Args:
        directory: of the realm.
        tag: of the process.
        name: of the robot that is meant; empty: all.
        system: with the files.
    """
    keys = keys_of(directory, tag, system)
    if keys is None:
        return [f"robot/{name or _EACH}/{_EACH}"]
    return [key for key in keys if (found := _ROBOT.fullmatch(key)) and name in {"", found[1]}]


def _content(directory: Path, tag: str, system: OSFiles) -> bytes | None:
    """Return what is in a process's list of keys; None: it cannot be read."""
    try:
        return system.read(directory / f"{tag}{HELD}", LONGEST_LIST)
    except OSError:
        return None


def _proven(written: bytes) -> bytes | None:
    """Return the lines of a list that its seal proves; None: it is damaged.

    What lies behind them has been added and not yet sealed: its process is not present under it yet.
    """
    found = _SEAL.match(written)
    if found is None:
        return None
    lines = written[found.end() : found.end() + int(found[1])]
    return lines if written.startswith(sealed(lines)) else None


def _counted(lines: bytes) -> Counter[str]:
    """Return how often a process is present under each key."""
    keys = Counter[str]()
    for line in lines.decode(errors="replace").split("\n")[:-1]:  # the last one may just be written
        key = line.removeprefix("-")
        keys[key] += 1 if key == line else -1
    return keys


def robots_in(directory: Path) -> list[str]:
    """Return the names of the robots that the living processes of a realm have written down.

    Of a damaged list it is what can be understood.
    """
    return present_in(directory).get("robot", [])


def present_in(directory: Path) -> dict[str, list[str]]:
    """Return the names of all agents that the living processes of a realm have written down, by role.

    Of a damaged list it is what can be understood.
    """
    living = (tag for tag in members(directory) if OS_FILES.lives(process_of(tag)))
    keys = (key for tag in living for key in _counted(_content(directory, tag, OS_FILES) or b"").elements())
    found = sorted({(agent[1], agent[2]) for key in keys if (agent := _AGENT.fullmatch(key))})
    return {role: [name for each, name in found if each == role] for role in {role for role, _ in found}}


def dial(directory: Path, tag: str, timeout: float = 0.0, system: OSFiles = OS_FILES) -> Socket:
    """Connect to a process.

    Args:
        directory: in which the process has its entry.
        tag: of the process.
        timeout: [s] of the connection, and to wait for a place in its line, if too many others wait there
            already; 0: it does not block.
        system: on which both live.

    Raises:
        ConnectionRefusedError: it is dead.
        OSError: it cannot be connected to now.
    """
    return system.dial(directory / f"{tag}{SOCKET}", timeout)


# -- inside ----------------------------------------------------------------------------------------


def _twin(directory: Path) -> Path | None:
    """Return the other folder of a realm that lies in one of the two usual runtime directories."""
    user = os.geteuid()
    if directory.parent.name not in {"robotree", f"robotree-{user}"}:
        return None  # at once, for this is asked often
    usual = [LOGIN / str(user) / "robotree", SHARED.resolve() / f"robotree-{user}"]
    if directory.parent not in usual:
        return None
    usual.remove(directory.parent)
    return usual[0] / directory.name


def _private(path: Path, system: OSFiles) -> bool:
    """Whether a path is a folder that only this user can enter."""
    try:
        found = system.status(path)
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == system.user() and not found.st_mode & OTHERS


def _has_members(directory: Path) -> bool:
    """Whether a folder is ours and has the entry of a living process."""
    owner = owner_of(directory)
    ours = _owner(directory) == (os.geteuid() if owner is None else owner)
    return ours and any(OS_FILES.lives(process_of(tag)) for tag in members(directory))


def _known_to_the_kernel() -> set[Path]:
    """Return the folders of all realms in which a process of this user listens."""
    roots, user = {"robotree", f"robotree-{os.geteuid()}"}, os.geteuid()
    found = {path.parent: path.name.removeprefix(".") for path in listening_anywhere()}
    return {
        directory
        for directory, tag in found.items()
        if (directory.parent.name in roots or owner_of(directory) is not None)
        and TAG.fullmatch(tag)
        and _owner(Path(f"/proc/{process_of(tag)}")) == user
    }


def _owner(path: Path) -> int | None:
    try:
        return os.lstat(path).st_uid
    except OSError:
        return None


# -- which processes live, as the kernel knows them, whatever became of their files ----------------

# Linux lists the sockets on which processes listen by the path that each was given, also when the path, or
# the whole folder, has been removed since (proc_pid_net(5), `/proc/net/unix`). So a process that nobody can
# reach any more is still known. Elsewhere nothing is known here.

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
