"""Checks of a realm's meeting place: the folder, the process behind each entry, and what they hold.

Everything is read from files and from the system, nobody is asked: so it also says the truth of processes
that hang, and it works where the realm cannot be joined.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from robotree.tui.diagnosis.finding import Finding
from robotree.vr.base.address import Address
from robotree.vr.network.mesh import HANGS
from robotree.vr.network.realms import process_of, realm_folder, runtime_directory
from robotree.vr.network.rendezvous import Rendezvous

PRIVATE = 0o700
LISTENS, ESTABLISHED = "0A", "01"
"""States of a TCP socket in /proc/net/tcp (Linux, include/net/tcp_states.h)."""
_SOCKET = re.compile(r"socket:\[(\d+)]")

Condition = Literal["lives", "hangs", "stopped", "dead"]


@dataclass(frozen=True, slots=True)
class Entry:
    """One process that has entered a realm."""

    pid: int
    condition: Condition
    silent: float
    """[s] since its last sign of life."""
    holds: tuple[Address, ...]
    """The agents that it is."""
    command: str
    """Its command line, where it can be read."""

    @property
    def who(self) -> str:
        """Name it for people."""
        agents = ", ".join(f"{one.role} {one.name}" for one in self.holds)
        return f"process {self.pid} ({agents or self.command or 'it has announced nothing'})"


def folder(realm: str) -> Iterator[Finding]:
    """See that the realm's folder can be used, and by nobody else."""
    if not os.environ.get("XDG_RUNTIME_DIR"):
        told = f"XDG_RUNTIME_DIR is not set, so this realm lies in {realm_folder(realm).parent}"
        yield Finding(
            "folder", "doubt", told, "set it alike in all terminals, or robots of one are not seen in others"
        )
    place = realm_folder(realm)
    for path in (place.parent, place):
        try:
            found = path.lstat()
        except FileNotFoundError:
            others = realms()
            hint = f"; there are realms {', '.join(others)}: use --realm NAME" if others else ""
            yield Finding(
                "folder", "bad", f"{path} is not there: nobody is in realm {realm!r}",
                f"start something, for example `robotree demo`{hint}",
            )  # fmt: skip
            return
        except OSError as error:
            yield Finding(
                "folder", "bad", f"{path}: {error.strerror}", "set XDG_RUNTIME_DIR to a folder of your own"
            )
            return
        if fault := _fault(path, found):
            yield fault
            return
    yield Finding("folder", "good", f"{place} is yours alone")


def _fault(path: Path, found: os.stat_result) -> Finding | None:
    mode = stat.S_IMODE(found.st_mode)
    own = "set XDG_RUNTIME_DIR to a folder of your own"
    if not stat.S_ISDIR(found.st_mode):
        return Finding("folder", "bad", f"{path} is no folder", f"remove it: rm {path}")
    if found.st_uid != os.geteuid():
        return Finding("folder", "bad", f"{path} belongs to user {found.st_uid}, you are {os.geteuid()}", own)
    if mode & 0o077 or mode & PRIVATE != PRIVATE:
        return Finding("folder", "bad", f"{path} has mode {mode:04o}, not 0700", f"chmod 700 {path}")
    return None


def realms() -> list[str]:
    """Return the realms of this user."""
    try:
        return sorted(path.name for path in runtime_directory().iterdir() if path.is_dir())
    except OSError:
        return []


def entries(realm: str) -> list[Entry]:
    """Return the processes that have entered a realm, also ended ones. Its folder must be sound."""
    place = Rendezvous(realm)
    found: list[Entry] = []
    for tag in place.others():
        pid = process_of(tag)
        silent = 0.0
        if beat := place.beat_of(tag):
            silent = max(time.monotonic() - beat.read(), 0.0)
            beat.close()
        holds = tuple(
            address for address in map(Address.parse, place.keys_of(tag) or ()) if address is not None
        )
        condition = "dead" if not _answers_the_door(place, tag) else _condition(pid, silent)
        found.append(Entry(pid, condition, silent, holds, command_of(pid)))
    return found


def _answers_the_door(place: Rendezvous, tag: str) -> bool:
    """Whether a process listens behind an entry, as the system knows."""
    try:
        place.dial(tag).close()
    except (ConnectionRefusedError, FileNotFoundError):
        return False
    except OSError:
        return True  # its queue is full: a process listens
    return True


def _condition(pid: int, silent: float) -> Condition:
    if state_of(pid) in {"T", "t"}:
        return "stopped"
    return "hangs" if silent > HANGS else "lives"


def state_of(pid: int) -> str:
    """Return the system's letter for what a process does (proc(5)); empty: it is not there."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return ""


def command_of(pid: int) -> str:
    """Return a process's command line from its verb on; empty: it cannot be read."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return ""
    begins = next(
        (place for place, word in enumerate(words) if word.endswith(("robotree", "robotree.tui"))), 0
    )
    return " ".join(word for word in words[begins + 1 :] if word)


def processes(found: list[Entry]) -> Iterator[Finding]:
    """Report each process that has ended or hangs, and what to do."""
    for one in found:
        match one.condition:
            case "dead":
                yield Finding(
                    "processes", "doubt", f"{one.who} has died and left its entry",
                    "nothing to do: the next that looks removes it",
                )  # fmt: skip
            case "stopped":
                yield Finding(
                    "processes", "bad", f"{one.who} is stopped (SIGSTOP, Ctrl-Z or a debugger)",
                    f"wake it: kill -CONT {one.pid}; or end it: kill -KILL {one.pid}",
                )  # fmt: skip
            case "hangs":
                yield Finding(
                    "processes", "bad", f"{one.who} has given no sign of life for {one.silent:.0f} s",
                    f"look what it waits for, or end it: kill -KILL {one.pid}",
                )  # fmt: skip
            case "lives":
                pass
    alive = sum(one.condition == "lives" for one in found)
    if alive:
        yield Finding("processes", "good", f"{alive} of {len(found)} live and answer the system")
    else:
        yield Finding(
            "processes",
            "bad",
            "no process runs in this realm",
            "start something, for example `robotree demo`",
        )


def roles(found: list[Entry]) -> Iterator[Finding]:
    """See that there are lookup services and hosts."""
    alive = [address for one in found if one.condition == "lives" for address in one.holds]
    lookups = sorted(one.name for one in alive if one.role == "lookup")
    hosts = sorted(one.name for one in alive if one.role == "host")
    if lookups:
        yield Finding("lookups", "good", f"{', '.join(lookups)} live")
    else:
        yield Finding(
            "lookups", "bad", "no lookup service runs, so lists may be old", "robotree lookup lookup-1"
        )
    if hosts:
        yield Finding("hosts", "good", f"{', '.join(hosts)} live")
    else:
        yield Finding(
            "hosts", "doubt", "no host runs, so no virtual robot can be created", "robotree host host-1"
        )


def whereabouts(name: str, realm: str) -> Finding | None:
    """Return in which other realm a robot is; None: in none of this user's."""
    for other in realms():
        if other == realm:
            continue
        with contextlib.suppress(Exception):  # a folder that is not in order is no reason to fail here
            for one in entries(other):
                if any(address.name == name for address in one.holds):
                    return Finding(
                        "robot",
                        "bad",
                        f"{name} is in realm {other!r}, not in {realm!r}",
                        f"add --realm {other}",
                    )
    return None


def links(found: list[Entry]) -> Iterator[Finding]:
    """Tell the TCP connections of the processes, and which of them wait for a port where nothing listens."""
    known = _tcp()
    for one in found:
        if one.condition == "dead":
            continue
        sockets = [known[inode] for inode in _sockets(one.pid) if inode in known]
        told = [f"listens at {near}" for near, _, state in sockets if state == LISTENS]
        told += [f"{near} to {far}" for near, far, state in sockets if state == ESTABLISHED]
        wanted = [_whole(address) for address in re.findall(r"--connect[= ]tcp:([^\s?]+)", one.command)]
        joined = {far for _, far, state in sockets if state == ESTABLISHED}
        for address in wanted:
            if address not in joined:
                yield Finding(
                    "links", "bad", f"{one.who} is not connected to tcp:{address}",
                    f"start what shall listen there, for example `robotree sim arm --listen tcp:{address}`",
                )  # fmt: skip
        if told:
            yield Finding("links", "good", f"{one.who}: {'; '.join(told)}")


def _whole(address: str) -> str:
    """Return an address with its host in numbers, where it is this machine's."""
    host, colon, port = address.rpartition(":")
    return f"{'127.0.0.1' if not colon or host == 'localhost' else host}:{port}"


def _sockets(pid: int) -> Iterator[str]:
    """Return the inodes of a process's sockets; none where they cannot be read."""
    with contextlib.suppress(OSError):
        for path in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                if found := _SOCKET.fullmatch(str(path.readlink())):
                    yield found[1]


def _tcp() -> Mapping[str, tuple[str, str, str]]:
    """Return near and far address and state of each TCP socket of this machine, by inode (proc(5))."""
    try:
        lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    except OSError:
        return {}
    fields = [line.split() for line in lines]
    return {one[9]: (_address(one[1]), _address(one[2]), one[3]) for one in fields}


def _address(text: str) -> str:
    """Read an address such as `0100007F:1680`: bytes of the host backwards, port forwards."""
    host, _, port = text.partition(":")
    return f"{'.'.join(str(byte) for byte in bytes.fromhex(host)[::-1])}:{int(port, 16)}"
