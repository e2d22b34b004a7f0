"""Checks of a realm's meeting place: the folder, the process behind each entry, and what they hold.

Everything is read from files and from the system, nobody is asked: so it also says the truth of processes
that hang, and it works where the realm cannot be joined.
"""

from __future__ import annotations

import contextlib
import ipaddress
import os
import re
import socket
import stat
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import psutil

from robotree.tui.diagnosis.finding import Finding
from robotree.vr.base.address import Address
from robotree.vr.base.principal import user_name
from robotree.vr.network.mesh import HANGS
from robotree.vr.network.realms import owner_of, process_of, realm_folder, runtime_directory
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.network.shared import SharedRealm, group_name, shared_realm

PRIVATE = 0o700
OWN = "set XDG_RUNTIME_DIR to a folder of your own"

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
    damaged: bool = False
    """Whether its list of agents is damaged, so that nobody who comes now knows them."""

    @property
    def who(self) -> str:
        """Name it for people."""
        agents = ", ".join(f"{hold.role} {hold.name}" for hold in self.holds)
        unknown = "its list of agents is damaged" if self.damaged else "it has announced nothing"
        return f"process {self.pid} ({agents or self.command or unknown})"


def folder(realm: str) -> Iterator[Finding]:
    """See that the realm's folder can be used, and by nobody else."""
    if not os.environ.get("XDG_RUNTIME_DIR") and owner_of(realm_folder(realm)) is None:
        result = f"XDG_RUNTIME_DIR is not set, so this realm lies in {realm_folder(realm).parent}"
        remedy = "set it alike in all terminals, or robots of one are not seen in others"
        yield Finding("folder", "doubt", result, remedy)
    place = realm_folder(realm)
    if (shared := shared_realm(place)) is not None:
        yield _shared(shared, realm)
        return
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
            yield Finding("folder", "bad", f"{path}: {error.strerror}", OWN)
            return
        if fault := _fault(path, found):
            yield fault
            return
    yield Finding("folder", "good", f"{place} is yours alone")


def _shared(shared: SharedRealm, realm: str) -> Finding:
    """See that the folder of a realm that users share can be used, and is its owner's."""
    owner = user_name(shared.owner)
    try:
        shared.prepare()
    except OSError as error:
        remedy = f"{owner} makes it: robotree realm create {realm} --group GROUP, with a group of yours"
        return Finding("folder", "bad", f"{error.filename or shared.directory}: {error.strerror}", remedy)
    group = group_name(shared.directory.stat().st_gid)
    return Finding("folder", "good", f"{shared.directory} is shared by {owner} with the group {group}")


def _fault(path: Path, found: os.stat_result) -> Finding | None:
    mode = stat.S_IMODE(found.st_mode)
    if not stat.S_ISDIR(found.st_mode):
        return Finding("folder", "bad", f"{path} is no folder", f"remove it: rm {path}")
    if found.st_uid != os.geteuid():
        return Finding("folder", "bad", f"{path} belongs to user {found.st_uid}, you are {os.geteuid()}", OWN)
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
        keys = place.keys_of(tag)
        holds = tuple(address for address in map(Address.parse, keys or ()) if address is not None)
        gateways = tuple(one for one in holds if one.role == "gateway")
        holds = gateways or holds  # it stands for all that is at other sites
        condition = "dead" if not _answers_the_door(place, tag) else _condition(pid, silent)
        damaged = keys is None and condition != "dead"
        found.append(Entry(pid, condition, silent, holds, command_of(pid), damaged))
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
    with contextlib.suppress(psutil.Error):
        if psutil.Process(pid).status() in {psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP}:
            return "stopped"
    return "hangs" if silent > HANGS else "lives"


def command_of(pid: int) -> str:
    """Return a process's command line from its verb on; empty: it cannot be read."""
    try:
        words = psutil.Process(pid).cmdline()
    except psutil.Error:
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
        if one.damaged:
            yield Finding(
                "processes", "bad",
                f"the list of agents of {one.who} is damaged or gone: nobody who comes now knows its robots",
                f"it mends it within a second if it runs; else end it: kill -KILL {one.pid}",
            )  # fmt: skip
    alive = sum(one.condition == "lives" for one in found)
    if alive:
        yield Finding("processes", "good", f"{alive} of {len(found)} live and answer the system")
    else:
        remedy = "start something, for example `robotree demo`"
        yield Finding("processes", "bad", "no process runs in this realm", remedy)


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
            for entry in entries(other):
                if any(address.name == name for address in entry.holds):
                    there = f"{name} is in realm {other!r}, not in {realm!r}"
                    return Finding("robot", "bad", there, f"add --realm {other}")
    return None


def links(found: list[Entry]) -> Iterator[Finding]:
    """Tell the TCP connections of the processes, and which of them wait for a port where nothing listens."""
    for one in found:
        if one.condition == "dead":
            continue
        sockets = _sockets(one.pid)
        joined = {_place(far) for _, far in sockets if far}
        results = [
            f"{_written(near)} to {_written(far)}" if far else f"listens at {_written(near)}"
            for near, far in sockets
        ]
        for wanted in re.findall(r"--connect[= ]tcp:([^\s?]+)", one.command):
            if joined.isdisjoint(_places(wanted)):
                yield Finding(
                    "links", "bad", f"{one.who} is not connected to tcp:{wanted}",
                    f"start what shall listen there, for example `robotree sim arm --listen tcp:{wanted}`",
                )  # fmt: skip
        if results:
            yield Finding("links", "good", f"{one.who}: {'; '.join(results)}")


Place = tuple[str, int]
"""Host in numbers and port, as the system knows a TCP socket's end."""


def _sockets(pid: int) -> list[tuple[Place, Place | None]]:
    """Return near and far end of each TCP socket of a process that is connected, or listens (no far end)."""
    try:
        known = psutil.Process(pid).net_connections(kind="tcp")
    except psutil.Error:
        return []
    return [
        ((one.laddr.ip, one.laddr.port), (one.raddr.ip, one.raddr.port) if one.raddr else None)
        for one in known
        if one.status in {psutil.CONN_LISTEN, psutil.CONN_ESTABLISHED}
    ]


def _place(end: Place) -> Place:
    """Return an end with its host in one way of writing: also one of IPv4 that an IPv6 socket reached."""
    host = ipaddress.ip_address(end[0].partition("%")[0])
    mapped = host.ipv4_mapped if isinstance(host, ipaddress.IPv6Address) else None
    return str(mapped or host), end[1]


def _places(address: str) -> set[Place]:
    """Return the ends that an address of the command line means: a name may have several."""
    host, _, port = address.rpartition(":")
    with contextlib.suppress(OSError, ValueError):
        found = socket.getaddrinfo(host.strip("[]") or "127.0.0.1", int(port), type=socket.SOCK_STREAM)
        return {_place((str(end[0]), int(end[1]))) for *_, end in found}
    return set()


def _written(end: Place) -> str:
    host, port = end
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
