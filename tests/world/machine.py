"""A simulated machine under the real network: processes, descriptors, files, sockets, and their faults.

Each process of it has a `SimulatedSystem`, so that `network/` runs in the World as it is. Whatever a process
asks of its system is a point at which it may lose the processor (`VirtualRunner.point`). What goes wrong is
in `Trouble` (`kernel.py`), and in what a story does: `end`, `links_between`, `lose_folder`, `disk_full`.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import itertools
import logging
import os
import stat
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, Self, TypeVar, cast

from robotree.files import forks
from robotree.vr.network import local
from robotree.vr.network.door import RESERVE
from robotree.vr.network.link import Topic
from robotree.vr.network.mesh import Mesh
from robotree.vr.world.disk import fail
from robotree.vr.world.virtual_runner import VirtualLock, VirtualProcess, VirtualRunner
from robotree.vr.world.world import Main, SimulatedProcess, World
from tests.world.kernel import CAPACITY, Descriptors, Kernel, SimulatedEpoll, SimulatedSocket
from tests.world.points import at_every_statement

USER = os.geteuid()
"""Of all processes: the one that owns this realm."""

_UNIX_SOCKETS = Path("/proc/net/unix")


class _File:
    """An ordinary file, or an open one."""

    def __init__(self, inode: int) -> None:
        self.inode = inode
        self.data = bytearray()
        self.changed = 0
        """[ns] When it was last written."""


class _OpenFile:
    def __init__(self, file: _File) -> None:
        self.file, self.number = file, -1

    def release(self) -> None:
        self.number = -1


_Entry = _File | SimulatedSocket


@dataclass(frozen=True)
class _Status:
    """As far as anybody asks (`os.stat_result`)."""

    st_mode: int
    st_ino: int
    st_uid: int
    st_size: int
    st_mtime: float
    st_mtime_ns: int


class Machine(Kernel):
    """A simulated machine: its processes, its network and what goes wrong in it."""

    def __init__(self, runner: VirtualRunner, seed: int) -> None:
        """Begin without a process.

        Args:
            runner: in whose time it runs.
            seed: of its chance.
        """
        super().__init__(runner, seed)
        self.systems: dict[int, SimulatedSystem] = {}
        """By process."""
        self.folders: dict[str, dict[str, _Entry]] = {}
        """The entries of each folder, by its path."""
        self.listeners: list[SimulatedSocket] = []
        """Sockets that listen, also those whose name is gone."""
        self.disk_full = False
        self._inodes = itertools.count(1)

    # -- for stories ------------------------------------------------------------------------------

    def boot(self, process: VirtualProcess) -> SimulatedSystem:
        """Return the system of a process that begins."""
        system = self.systems[process.pid()] = SimulatedSystem(self, process)
        return system

    def end(self, process: VirtualProcess) -> None:
        """Close all that a process has open: it has ended."""
        system = self.systems.pop(process.pid(), None)
        if system is not None:
            when = self.runner.now()
            for number in sorted(system.descriptors):
                one = system.descriptors[number]
                when += self.random.random() * self.trouble.slow_death
                if when == self.runner.now():
                    one.release()
                else:
                    self.runner.at(when, one.release)
            system.descriptors.clear()

    def links_between(self, one: VirtualProcess, other: VirtualProcess) -> list[SimulatedSocket]:
        """Return the ends of all connections between two processes."""
        pair = {one.pid(), other.pid()}
        return [
            end
            for pid in sorted(pair & self.systems.keys())
            for end in self.systems[pid].descriptors.values()
            if isinstance(end, SimulatedSocket)
            and end.peer is not None
            and {end.system.process.pid(), end.peer.system.process.pid()} == pair
        ]

    def lose_folder(self, folder: Path) -> None:
        """Remove a folder with all that is in it, as `rm -r` does."""
        self.folders.pop(str(folder), None)

    # -- for its processes ------------------------------------------------------------------------

    def place_of(self, path: Path) -> tuple[dict[str, _Entry], str]:
        """Return the folder in which a name is or can be.

        Raises:
            FileNotFoundError: there is none.
        """
        folder, _, name = str(path).rpartition("/")
        entries = self.folders.get(folder)
        if entries is None:
            fail(errno.ENOENT, path)
        return entries, name

    def find(self, path: Path) -> _Entry:
        """Return what has a name.

        Raises:
            FileNotFoundError: nothing has.
        """
        entries, name = self.place_of(path)
        if name not in entries:
            fail(errno.ENOENT, path)
        return entries[name]

    def new_file(self) -> _File:
        """Return a file that has no name yet."""
        return _File(next(self._inodes))


class SimulatedSystem(Descriptors):
    """The machine as one process sees it: see `System`."""

    def __init__(self, machine: Machine, process: VirtualProcess) -> None:
        """Made by the machine."""
        super().__init__(machine, process)
        self.machine = machine
        self.exits: list[Callable[[], object]] = []
        """Functions for its orderly end."""
        self.opening: AbstractContextManager[Any] = nullcontext()
        runner = machine.runner
        self.now, self.unix, self.pid, self.here = process.now, process.unix, process.pid, runner.here
        self.name_thread, self.event = runner.name_thread, runner.event
        self.chance = machine.random.randbytes

    # -- threads ----------------------------------------------------------------------------------

    def owns(self, owner: forks.Owner) -> None:
        """See `System.owns`: nobody forks here."""

    def at_exit(self, action: Callable[[], object], /) -> None:
        self.exits.append(action)

    def not_at_exit(self, action: Callable[[], object], /) -> None:
        if action in self.exits:
            self.exits.remove(action)

    def lock(self) -> VirtualLock:
        return VirtualLock(self.machine.runner)

    def rlock(self) -> VirtualLock:
        return VirtualLock(self.machine.runner, again=True)

    def spawn(self, work: Callable[[], None], name: str) -> None:
        self.machine.call()
        self.process.spawn(work, name)

    def sleep(self, seconds: float, /) -> None:
        self.process.waiter().wait(seconds)

    # -- processes --------------------------------------------------------------------------------

    def user(self) -> int:
        return USER

    def lives(self, pid: int) -> bool:
        self.machine.call()
        return pid in self.machine.systems

    def text(self, path: Path) -> str:
        """See `OSFiles.text`: what Linux shows of listening sockets and of a process."""
        self.machine.call()
        if path == _UNIX_SOCKETS:
            lines = (
                f"0: 00000002 00000000 00010000 0001 01 1 {listener.path}"
                for listener in self.machine.listeners
            )
            return "\n".join(["Num RefCount Protocol Flags Type St Inode Path", *lines])
        system = self.machine.systems.get(int(path.parts[2]))
        if system is None:
            fail(errno.ENOENT, path)
        return f"{path.parts[2]} (python) {'T' if system.process.halted else 'S'} 1"

    # -- descriptors ------------------------------------------------------------------------------

    def _file(self, number: int) -> _File:
        one = self.descriptors.get(number)
        if not isinstance(one, _OpenFile):
            fail(errno.EBADF)
        return one.file

    # -- files ------------------------------------------------------------------------------------

    def private_folder(self, path: Path) -> None:
        self.machine.call()
        for folder in (*reversed(path.parents), path):
            self.machine.folders.setdefault(str(folder), {})

    def names(self, folder: Path) -> list[str]:
        self.machine.call()
        entries = self.machine.folders.get(str(folder))
        if entries is None:
            fail(errno.ENOENT, folder)
        names = list(entries)
        self.machine.random.shuffle(names)
        return names

    def status(self, path: Path) -> Any:
        self.machine.call()
        if str(path) in self.machine.folders:
            return _Status(stat.S_IFDIR | 0o700, 0, USER, 0, 0.0, 0)
        entry = self.machine.find(path)
        seconds = entry.changed / 1e9
        if isinstance(entry, SimulatedSocket):
            return _Status(stat.S_IFSOCK | 0o600, 0, USER, 0, seconds, entry.changed)
        return _Status(stat.S_IFREG | 0o600, entry.inode, USER, len(entry.data), seconds, entry.changed)

    def opened(self, path: Path, *, writes: bool = False, makes: bool = False, empties: bool = False) -> int:
        self.machine.call()
        self.check_descriptors()
        entries, name = self.machine.place_of(path)
        if makes and name not in entries:
            if self.machine.disk_full:
                fail(errno.ENOSPC, path)
            entries[name] = self.machine.new_file()
        entry = self.machine.find(path)
        if isinstance(entry, SimulatedSocket):
            fail(errno.ENXIO, path)
        if empties and writes:
            self._write(entry, bytearray())
        return self._opened(entry)

    def null(self) -> int:
        self.machine.call()
        return self._opened(self.machine.new_file())

    def _opened(self, file: _File) -> int:
        handle = _OpenFile(file)
        handle.number = self.take(handle)
        return handle.number

    def close(self, descriptor: int) -> None:
        self.give_back(descriptor)

    def read(self, path: Path, most: int) -> bytes:
        self.machine.call()
        self.check_descriptors()
        entry = self.machine.find(path)
        if isinstance(entry, SimulatedSocket):
            fail(errno.ENXIO, path)
        if len(entry.data) > most:
            fail(errno.EFBIG, path)
        return bytes(entry.data)

    def pread(self, descriptor: int, size: int, at: int) -> bytes:
        self.machine.call()
        return bytes(self._file(descriptor).data[at : at + size])

    def pwrite(self, descriptor: int, data: bytes, at: int) -> int:
        self.machine.call()
        file = self._file(descriptor)
        if self.machine.disk_full and at + len(data) > len(file.data):
            fail(errno.ENOSPC)
        content = bytearray(file.data)
        content.extend(bytes(max(at - len(content), 0)))
        content[at : at + len(data)] = data
        self._write(file, content)
        return len(data)

    def append(self, descriptor: int, data: bytes) -> int:
        """See `OSFiles.append`. On a full disk a part of it may find room."""
        self.machine.call()
        file = self._file(descriptor)
        if self.machine.disk_full:
            data = data[: self.machine.random.randrange(len(data))] if data else data
            if not data:
                fail(errno.ENOSPC)
        self._write(file, file.data + data)
        return len(data)

    def _write(self, file: _File, content: bytearray) -> None:
        file.data = content
        file.changed = max(file.changed + 1, int(self.unix() * 1e9))

    def rename(self, path: Path, to: Path) -> None:
        self.machine.call()
        entry = self.machine.find(path)
        there, name = self.machine.place_of(to)
        there[name] = entry
        here, before = self.machine.place_of(path)
        if (here, before) != (there, name):
            del here[before]

    def unlink(self, path: Path) -> None:
        self.machine.call()
        self.machine.find(path)
        entries, name = self.machine.place_of(path)
        del entries[name]

    # -- sockets ----------------------------------------------------------------------------------

    def listen(self, path: Path, backlog: int) -> SimulatedSocket:
        self.machine.call()
        self.check_descriptors()
        entries, name = self.machine.place_of(path)
        if name in entries:
            fail(errno.EADDRINUSE, path)
        door = entries[name] = self._socket()
        door.path, door.backlog, door.listens = str(path), backlog, True
        door.changed = int(self.unix() * 1e9)
        self.machine.listeners.append(door)
        door.on_release = lambda: self.machine.listeners.remove(door)
        self.machine.call()  # between bind and listen
        return door

    def dial(self, path: Path, timeout: float = 0.0) -> SimulatedSocket:
        machine = self.machine
        machine.call()
        self.check_descriptors()
        door = machine.find(path)
        if not isinstance(door, SimulatedSocket) or not door.listens:
            fail(errno.ECONNREFUSED)
        if len(door.queue) > door.backlog or machine.happens(machine.trouble.full_backlog):
            if timeout:
                self.sleep(timeout)
            fail(errno.EAGAIN)
        line, far = self._socket(), SimulatedSocket(door.system)
        self._connect(line, far)
        door.queue.append(far)
        if late := machine.trouble.late_accept:
            machine.later(late, lambda: door.edge(0))
        else:
            door.edge(0)
        return line

    def socketpair(self) -> tuple[SimulatedSocket, SimulatedSocket]:
        self.machine.call()
        ends = self._socket(), self._socket()
        self._connect(*ends)
        for end in ends:
            end.capacity = CAPACITY
        return ends

    def epoll(self) -> SimulatedEpoll:
        self.machine.call()
        self.check_descriptors()
        return SimulatedEpoll(self)

    def far_end(self, line: Any) -> tuple[int, int]:
        peer = cast("SimulatedSocket", line).peer
        if peer is None:
            fail(errno.ENOTCONN)
        return peer.system.process.pid(), USER

    def _socket(self) -> SimulatedSocket:
        one = SimulatedSocket(self)
        one.number = self.take(one)
        return one

    def _connect(self, one: SimulatedSocket, other: SimulatedSocket) -> None:
        one.peer, other.peer = other, one
        machine = self.machine
        for end in (one, other):
            if machine.happens(machine.trouble.small):
                end.capacity = machine.random.choice([64, 500, 5000])


ROOT = Path("/run/realms")
"""Where the realms of a simulated machine lie."""

REALM = "r"


class MachineProcess(SimulatedProcess):
    """One process of a simulated machine. It has a transport from the moment when it has joined the realm."""

    world: MachineWorld
    system: SimulatedSystem
    transport: local.LocalTransport  # type: ignore[assignment] # over another network
    joined = False
    """Whether it has entered the realm."""

    def _boot(self) -> None:
        self.system = self.loop.system = self.world.machine.boot(self.runner)

    def _stand_still(self) -> None:
        """Its descriptors stay open."""

    def _go_on(self) -> None:
        """What has come meanwhile lies in its sockets."""

    def _let_go(self) -> None:
        self.world.machine.end(self.runner)

    def _run(self, main: Main) -> None:
        async def whole(process: SimulatedProcess) -> None:
            self.transport = await local.join(REALM, root=ROOT)
            self.joined = True
            await main(process)

        super()._run(whole)
        for action in self.system.exits:
            action()


class MachineWorld(World):
    """A World whose processes live on one machine."""

    process_class = MachineProcess

    def __init__(self, seed: int) -> None:
        """Begin with nobody."""
        super().__init__(seed)
        self.machine = Machine(self.runner, seed)
        self.logged: list[str] = []
        """Errors that robotree has logged: faults, if there are any."""

    def __enter__(self) -> Self:
        self._stack.enter_context(errors_kept(self.logged))
        return super().__enter__()

    @property
    def digest(self) -> str:
        """See `World.digest`; it covers each byte that was sent."""
        machine = self.machine
        whole = f"{super().digest} {machine.checksum} {machine.calls} {self.runner.preemption.count}"
        return hashlib.blake2b(whole.encode(), digest_size=16).hexdigest()


class Told(Protocol):
    """A story that happens, and is judged."""

    def tell(self) -> None:
        """Let it all happen."""
        ...

    def complain(self, law: str) -> None:
        """Note that a law is broken."""
        ...


TheStory = TypeVar("TheStory", bound=Told)


def tell(story: Told) -> None:
    """Let a story happen; what it raises is a fault of the program, which its seed has found."""
    try:
        story.tell()
    except Exception as error:  # noqa: BLE001 # as said above
        story.complain(f"raised: {type(error).__name__}: {error}")


def play_on_machine(
    make: Callable[[int, MachineWorld], TheStory], seed: int, among: tuple[ModuleType, ...]
) -> tuple[str, TheStory]:
    """Play one seed of a story to its end.

    Args:
        make: the story, which takes the seed and its world.
        seed: of everything.
        among: modules in which a thread can lose the processor before every statement.

    Returns:
        The digest of its trace, and the story.
    """
    with MachineWorld(seed) as world, at_every_statement(among, world.runner.point):
        story = make(seed, world)
        tell(story)
        return world.digest, story


@contextlib.contextmanager
def errors_kept(lines: list[str]) -> Generator[None]:
    """Keep what robotree logs as an error inside the block, instead of printing it."""
    log, keeper = logging.getLogger("robotree"), _Keeper(lines)
    level, log.propagate = log.level, False
    log.setLevel(logging.ERROR)
    log.addHandler(keeper)
    try:
        yield
    finally:
        log.removeHandler(keeper)
        log.setLevel(level)
        log.propagate = True


class _Keeper(logging.Handler):
    """Keeps what is logged as an error, with the end of its traceback."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(logging.ERROR)
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        trace = traceback.format_exception(*record.exc_info)[-3:] if record.exc_info else []
        self._lines.append(f"{record.name}: {record.getMessage()}{''.join(trace)}")


OWN = 3
"""Sockets of a process that are no connections: the one on which it listens, and two to wake its readers."""


def network_is_whole(processes: Iterable[MachineProcess]) -> Iterator[str]:
    """Yield what is wrong: everybody hears everybody, with one picture of who is there, and nothing leaks."""
    alive = [process for process in processes if process.alive and process.joined]
    meshes = {process.transport.mesh.place.tag: process.transport.mesh for process in alive}
    held = sorted({key for mesh in meshes.values() for key in mesh._known[Topic.HOLDS]})
    for process in alive:
        mesh = process.transport.mesh
        sees = (*_sees_otherwise(mesh, set(meshes), held), *_knows_otherwise(mesh, meshes))
        for wrong in (*sees, *_leaks(process, len(alive))):
            yield f"{process.name} {wrong}"


def _sees_otherwise(mesh: Mesh, tags: set[str], held: list[str]) -> Iterator[str]:
    others = tags - {mesh.place.tag}
    awake = {tag for tag, peer in mesh._peers.items() if peer.awake}
    if awake != others or set(mesh._peers) != others:
        yield f"knows {sorted(mesh._peers)}, and there are {sorted(others)}"
    if mesh.presence.keys("**") != held:
        yield f"sees {mesh.presence.keys('**')}, and there is {held}"
    if {entry.key for entry in mesh.held("**")} != set(held):
        yield "finds other keys in the record than there are"
    if late := mesh.presence.late("**"):
        yield f"finds others late: {late}"
    if waiting := [number for peer in mesh._peers.values() for number in peer.exchanges]:
        yield f"still waits for the replies to {len(waiting)} requests"


def _knows_otherwise(mesh: Mesh, meshes: dict[str, Mesh]) -> Iterator[str]:
    """Each knows what the others serve, are present under, and want to hear."""
    for tag, peer in mesh._peers.items():
        for topic, keys in peer.known.items():
            there = set(meshes[tag]._known[topic]) if tag in meshes else set()
            if keys != there:
                yield f"knows of {tag} under {topic.name} {sorted(keys)}, and there is {sorted(there)}"
    served = {key: tag for tag, peer in mesh._peers.items() for key in peer.known[Topic.SERVES]}
    if {key: peer.tag for key, peer in mesh._where.items()} != served:
        yield "would send requests elsewhere than they are served"


def _leaks(process: MachineProcess, members: int) -> Iterator[str]:
    ends = process.system.descriptors.values()
    sockets = sum(isinstance(end, SimulatedSocket) for end in ends)
    files = len(ends) - sockets - 1  # one is what it waits with
    if sockets != OWN + 2 * (members - 1) or not 1 + RESERVE <= files <= RESERVE + members:
        yield f"has {sockets} sockets and {files} files open among {members} processes"
