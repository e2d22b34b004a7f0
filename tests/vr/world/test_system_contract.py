"""The simulated machine does what Linux does: scripts, also random ones, have equal results on both."""

from __future__ import annotations

import errno
import random
import stat
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robotree.vr.base.os_files import (
    AT_ONCE,
    BOTH_WAYS,
    CLOSED_THERE,
    FAILED,
    HUNG_UP,
    ON_CHANGE,
    READABLE,
    WRITABLE,
)
from robotree.vr.base.system import THIS_SYSTEM, Socket, System
from robotree.vr.network.realms import asleep, listening
from robotree.vr.world.virtual_runner import VirtualProcess, virtual_runner
from tests.world.machine import Machine

COMES = READABLE | CLOSED_THERE | ON_CHANGE
EVENTS = {
    READABLE: "readable",
    WRITABLE: "writable",
    CLOSED_THERE: "closed there",
    HUNG_UP: "hung up",
    FAILED: "failed",
}
Script = Callable[[System, Path], list[object]]


def on_linux(script: Script) -> list[object]:
    with tempfile.TemporaryDirectory() as folder:  # a short path: a socket's has 108 bytes
        return script(THIS_SYSTEM, Path(folder).resolve() / "realm")


def simulated(script: Script, seed: int = 0) -> list[object]:
    with virtual_runner(seed) as runner:
        process = VirtualProcess(runner, "process")
        system, results = Machine(runner, seed).boot(process), list[object]()
        process.spawn(lambda: results.extend(script(system, Path("/run/realm"))), "script")
        runner.run(10.0)
        return results


def test_the_simulated_machine_has_all_that_a_system_has() -> None:
    with virtual_runner(0) as runner:
        system = Machine(runner, 0).boot(VirtualProcess(runner, "process"))
        assert {name for name in dir(THIS_SYSTEM) if not name.startswith("_")} <= set(dir(system))


class Notes(list[object]):
    """What came of each step: its value, or its error."""

    def take(self, step: Callable[[], object]) -> object:
        try:
            result = step()
        except OSError as error:
            result = errno.errorcode[error.errno or 0]
        except ValueError:
            result = "ValueError"
        self.append(result)
        return result


class Bench:
    """Sockets with names, one epoll, and what came of each step."""

    def __init__(self, system: System, folder: Path) -> None:
        self.system, self.notes = system, Notes()
        self.sockets: dict[str, Socket] = {}
        self.numbers: dict[int, str] = {}
        self.epoll = system.epoll()
        system.private_folder(folder)
        self.path = folder / "door"
        self._add("door", system.listen(self.path, 10))

    def _add(self, name: str, one: Socket) -> None:
        self.sockets[name] = one
        self.numbers[one.fileno()] = name

    def dial(self, name: str) -> None:
        def step() -> None:
            line = self.system.dial(self.path)
            line.setblocking(False)
            self._add(name, line)

        self.notes.take(step)

    def accept(self, name: str) -> None:
        def step() -> None:
            line = self.sockets["door"].accept()[0]
            line.setblocking(False)
            self._add(name, line)

        self.notes.take(step)

    def pair(self, one: str, other: str) -> None:
        for name, end in zip((one, other), self.system.socketpair(), strict=True):
            end.setblocking(False)
            self._add(name, end)

    def send(self, name: str, data: bytes = b"hello") -> None:
        self.notes.take(lambda: self.sockets[name].send(data, AT_ONCE))

    def fill(self, name: str) -> None:
        """Send until there is no more room; how much that is, is the kernel's affair."""

        def step() -> None:
            while self.sockets[name].send(bytes(1 << 14), AT_ONCE):
                pass

        self.notes.take(step)

    def recv(self, name: str, size: int = 100) -> None:
        self.notes.take(lambda: self.sockets[name].recv(size))

    def drain(self, name: str) -> None:
        def step() -> object:
            while data := self.sockets[name].recv(1 << 20):
                assert data
            return "end"

        self.notes.take(step)

    def shutdown(self, name: str) -> None:
        self.notes.take(lambda: self.sockets[name].shutdown(BOTH_WAYS))

    def close(self, name: str) -> None:
        self.notes.take(self.sockets[name].close)

    def register(self, name: str, *, writes: bool = False) -> None:
        self.notes.take(lambda: self.epoll.register(self.sockets[name], COMES | (WRITABLE if writes else 0)))

    def modify(self, name: str, *, writes: bool) -> None:
        self.notes.take(lambda: self.epoll.modify(self.sockets[name], COMES | (WRITABLE if writes else 0)))

    def unregister(self, name: str) -> None:
        self.notes.take(lambda: self.epoll.unregister(self.sockets[name]))

    def poll(self) -> None:
        def step() -> object:
            found = self.epoll.poll(0.0)
            return [
                (self.numbers[number], *(word for event, word in EVENTS.items() if events & event))
                for number, events in found
            ]

        self.notes.take(step)

    def end(self) -> list[object]:
        for socket in self.sockets.values():
            socket.close()
        self.epoll.close()
        self.notes.take(lambda: self.epoll.poll(0.0))
        return self.notes


def files(system: System, folder: Path) -> list[object]:
    notes = Notes()
    name, other = folder / "name", folder / "other"
    notes.take(lambda: system.names(folder))
    notes.take(lambda: system.opened(name, makes=True))
    system.private_folder(folder)
    notes.take(lambda: stat.S_ISDIR(system.status(folder).st_mode))
    notes.take(lambda: system.names(folder))
    notes.take(lambda: system.opened(name))
    notes.take(lambda: system.opened(name, writes=True))
    notes.take(lambda: system.read(name, 10))
    notes.take(lambda: system.status(name))
    notes.take(lambda: system.unlink(name))
    notes.take(lambda: system.rename(name, other))
    handle = system.opened(name, writes=True, makes=True)
    first = system.status(name)
    notes.take(lambda: system.append(handle, b"one\n"))
    notes.take(lambda: system.pwrite(handle, b"ON", 0))
    notes.take(lambda: system.append(handle, b"two\n"))
    notes.take(lambda: system.pread(handle, 6, 2))
    notes.take(lambda: system.pread(handle, 100, 7))
    notes.take(lambda: system.pread(handle, 100, 70))
    notes.take(lambda: system.pwrite(handle, b"!", 10))
    notes.take(lambda: system.read(name, 100))
    notes.take(lambda: system.read(name, 5))
    second = system.status(name)
    notes += [first.st_ino == second.st_ino, second.st_size, stat.S_ISREG(second.st_mode)]
    notes += [second.st_mtime_ns >= first.st_mtime_ns, abs(second.st_mtime - system.unix()) < 10.0]
    notes += [first.st_uid == system.user()]
    new = system.opened(other, writes=True, makes=True, empties=True)
    system.append(new, b"new")
    system.rename(other, name)
    notes += [sorted(system.names(folder)), system.status(name).st_ino == first.st_ino]
    notes.take(lambda: system.pread(handle, 3, 0))
    notes.take(lambda: system.read(name, 100))
    system.close(system.opened(name, writes=True, empties=True))
    notes.take(lambda: system.pread(new, 3, 0))
    notes.take(lambda: system.rename(name, folder / "none" / "name"))
    notes.take(lambda: system.rename(name, name))
    system.unlink(name)
    notes.take(lambda: system.append(new, b"unlinked"))
    notes.take(lambda: system.pread(new, 100, 0))
    system.close(handle)
    system.close(new)
    notes.take(lambda: system.pread(new, 3, 0))
    notes.take(lambda: system.close(new))
    system.close(system.null())
    notes += [
        system.names(folder),
        len(system.chance(4)),
        system.lives(system.pid()),
        asleep(system.pid(), system),
    ]
    return notes


def doors(system: System, folder: Path) -> list[object]:
    notes = Notes()
    hidden, name = folder / ".hidden", folder / "name"
    notes.take(lambda: system.listen(hidden, 1))
    notes.take(lambda: system.dial(name))
    system.private_folder(folder)
    notes.take(lambda: system.dial(name))
    door = system.listen(hidden, 1)
    notes += [stat.S_ISSOCK(system.status(hidden).st_mode)]
    notes += [abs(system.status(hidden).st_mtime - system.unix()) < 10.0]
    notes.take(lambda: system.listen(hidden, 1))
    notes.take(lambda: system.opened(hidden))
    notes.take(lambda: system.read(hidden, 10))
    system.rename(hidden, name)
    notes.take(lambda: system.dial(hidden))
    notes += [listening(folder, system)]
    lines = [system.dial(name), system.dial(name)]
    notes.take(lambda: system.dial(name))
    notes += [system.far_end(lines[0]) == (system.pid(), system.user())]
    near = door.accept()[0]
    notes += [system.far_end(near) == (system.pid(), system.user())]
    lines.append(system.dial(name))
    system.unlink(name)
    notes += [listening(folder, system)]
    notes.take(lambda: system.dial(name))
    door.close()
    notes += [listening(folder, system), door.fileno()]
    notes.take(door.accept)
    for line in lines:
        line.setblocking(False)
        notes.take(lambda line=line: line.recv(10))
        notes.take(lambda line=line: line.recv(10))
        notes.take(lambda line=line: line.send(b"x", AT_ONCE))
        line.close()
    near.close()
    other = system.listen(name, 1)
    other.close()
    notes.take(lambda: system.dial(name))
    notes += [stat.S_ISSOCK(system.status(name).st_mode)]
    return notes


def edges(system: System, folder: Path) -> list[object]:
    """What is ready is reported once."""
    bench = Bench(system, folder)
    bench.register("door")
    bench.poll()
    bench.dial("a")
    bench.poll()
    bench.poll()
    bench.modify("door", writes=False)
    bench.poll()
    bench.register("a", writes=True)
    bench.register("a")
    bench.send("a")
    bench.poll()
    bench.accept("b")
    bench.accept("none")
    bench.register("b")
    bench.poll()
    bench.send("a", b"again")
    bench.recv("b", 3)
    bench.poll()
    bench.recv("b", 3)
    bench.recv("b")
    bench.recv("b")
    bench.poll()
    bench.fill("b")
    bench.modify("b", writes=True)
    bench.poll()
    bench.drain("a")
    bench.poll()
    bench.send("b", b"last")
    bench.close("b")
    bench.poll()
    bench.recv("a")
    bench.recv("a")
    bench.send("a")
    bench.poll()
    bench.modify("a", writes=False)
    bench.poll()
    bench.unregister("a")
    bench.unregister("a")
    bench.close("a")
    bench.register("a")
    bench.recv("a")
    return bench.end()


def an_end_with_data(system: System, folder: Path) -> list[object]:
    """An end can come together with what was sent before, and is reported once."""
    bench = Bench(system, folder)
    bench.pair("c", "d")
    bench.register("c")
    bench.register("d", writes=True)
    bench.poll()
    bench.send("c", b"unread")
    bench.send("d", b"lost")
    bench.close("c")
    bench.poll()
    bench.recv("d")
    bench.recv("d")
    bench.recv("d")
    bench.poll()
    return bench.end()


def fill_and_drain(bench: Bench) -> None:
    bench.pair("full", "drained")
    bench.register("full", writes=True)
    bench.fill("full")
    bench.poll()
    bench.drain("drained")
    bench.poll()
    bench.close("full")
    bench.close("drained")


STEPS = ["dial", "accept", "pair", *["send", "recv", "poll"] * 4, "register", "register", "modify"]
ENDS = ["fill", "close", "shutdown", "unregister"]
MOST = 12
"""Sockets that are open at a time."""


def at_random(seed: int) -> Script:
    """Sixty steps."""

    def script(system: System, folder: Path) -> list[object]:
        chance, bench, fresh = random.Random(seed), Bench(system, folder), map(str, range(1000))
        bench.register("door")
        for _ in range(60):
            take_step(bench, chance, fresh)
        bench.poll()
        return bench.end()

    return script


def take_step(bench: Bench, chance: random.Random, fresh: Iterator[str]) -> None:
    names = [name for name, one in bench.sockets.items() if one.fileno() >= 0 and name != "door"]
    step, name = chance.choice(STEPS + ENDS), chance.choice(names) if names else ""
    size, writes = chance.choice([1, 10, 30, 1 << 20]), chance.random() < 0.5
    match step:
        case "dial" | "accept" if len(names) < MOST:
            getattr(bench, step)(next(fresh))
        case "pair" if len(names) < MOST:
            bench.pair(next(fresh), next(fresh))
        case "poll":
            bench.poll()
        case "fill":
            fill_and_drain(bench)
        case "send" if name:
            bench.send(name, bytes(size % 40))
        case "recv" if name:
            bench.recv(name, size)
        case "register" | "modify" if name:
            getattr(bench, step)(name, writes=writes)
        case "close" | "shutdown" | "unregister" if name:
            getattr(bench, step)(name)


@pytest.mark.parametrize("script", [files, doors, edges, an_end_with_data])
def test_a_script_has_the_same_results_on_linux_and_on_the_simulated_machine(script: Script) -> None:
    results = on_linux(script)
    assert simulated(script) == results
    assert len(results) > 10


@pytest.mark.parametrize("first", range(0, 300, 60))
def test_random_steps_with_sockets_have_the_same_results(first: int) -> None:
    for seed in range(first, first + 60):
        script = at_random(seed)
        assert simulated(script) == on_linux(script), f"seed {seed}"
