"""The World: simulated processes, the network between them, and a trace of what happens, from one seed.

A process has an event loop and a transport of its own, runs until its main coroutine returns, and can be
paused, killed, or cut off with its machine. `World` is generic: which agents live in the processes is decided
by those who build it (`tests/world` builds a whole realm with proxies and controllers).

The same seed gives the same trace, in the same process of the operating system and in another one: time,
order, keys and addresses all come from the seed, and the garbage collector is off while the World runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import hashlib
import logging
import random
import sys
import warnings
import zlib
from collections.abc import Awaitable, Callable, Coroutine
from types import TracebackType
from typing import Any, Self

import msgspec

from robotree.vr.base import chance
from robotree.vr.base.envelope import on_clock
from robotree.vr.base.errors import VrError
from robotree.vr.core.events import CoreEffect, CoreEvent
from robotree.vr.core.machine import RobotCore, RobotState, decode_state, encode_state
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner

Main = Callable[["SimulatedProcess"], Coroutine[Any, Any, None]]
"""The main function of a process; the process exits when it returns or raises."""

_encode = msgspec.msgpack.Encoder(enc_hook=repr).encode

TraceEntry = tuple[Any, ...]
"""One line of the trace: when [s], in which process, what, and details."""


class SimulatedProcess:
    """One process: an event loop, a transport, and the greenlets that belong to it."""

    def __init__(
        self, world: World, name: str, main: Main, *, skew: float, rate: float, offset: float
    ) -> None:
        """Made by `World.start`."""
        self.world, self.name = world, name
        self.runner = VirtualProcess(world.runner, name, skew=skew, rate=rate, offset=offset)
        self.loop = VirtualLoop(self.runner)
        self.loop.set_exception_handler(self._complain)
        self._boot()
        self.alive, self.vanished = True, False
        self.started = world.runner.now()
        """[s] When it was started."""
        self.on_exit: list[Callable[[], None]] = []
        """Called when it is gone, however; not in its own greenlets."""
        self.runner.spawn(lambda: self._run(main), name)

    def _boot(self) -> None:
        """Take what the process has from its beginning on."""
        self.transport: MemoryTransport = self.world.network.join(self.name, loop=self.loop)

    def do(self, work: Callable[[], Awaitable[Any]], what: str = "") -> None:
        """Have its event loop do something, from outside; how it ends is noted in the trace."""

        async def run() -> None:
            try:
                result = await work()
            except VrError as error:
                self.world.note(self.name, f"{what} refused", f"{type(error).__name__}: {error}")
            else:
                self.world.note(self.name, f"{what} done", repr(result))

        if self.alive:
            self.loop.call_soon_threadsafe(lambda: self.loop.create_task(run()))

    def pause(self) -> None:
        """Stop it as SIGSTOP does."""
        if self.alive:
            self.world.note(self.name, "paused")
            self.runner.pause()
            self._stand_still()

    def resume(self) -> None:
        """Let it go on, if it is paused."""
        if self.alive and self.runner.halted:
            self.world.note(self.name, "goes on")
            self.runner.resume()
            self._go_on()

    def kill(self) -> None:
        """End it as SIGKILL does: the others see it at once."""
        self._end("killed")

    def vanish(self) -> None:
        """End it together with its machine: the others only notice that it is silent."""
        self.vanished = True
        self._end("vanished")

    def _stand_still(self) -> None:
        self.world.network.pause(self.transport)

    def _go_on(self) -> None:
        self.world.network.resume(self.transport)

    def _let_go(self) -> None:
        """Close all that it has open: nothing of it runs any more."""
        network = self.world.network
        if not self.transport.closed:
            (network.vanish if self.vanished else network.kill)(self.transport)

    def _end(self, how: str) -> None:
        if not self.alive:
            return
        self.alive = False
        self.world.note(self.name, how)
        self.runner.end()
        self._let_go()
        for told in self.on_exit:
            told()

    def _run(self, main: Main) -> None:
        try:
            self.loop.run_until_complete(main(self))
        except VrError as error:
            self.world.note(self.name, "fails", f"{type(error).__name__}: {error}")
        self.world.runner.at(self.world.runner.now(), lambda: self._end("exited"))

    def _complain(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self.world.complaints.append(f"{self.name}: {context.get('message')}: {context.get('exception')!r}")


class TracedCore(RobotCore):
    """The machine of a robot whose events and effects are part of the trace."""

    __slots__ = ("_world",)

    def __init__(self, state: RobotState, world: World) -> None:
        """Made by `World.core`."""
        super().__init__(state)
        self._world = world

    def handle(self, event: CoreEvent, now: float) -> list[CoreEffect]:
        try:
            effects = super().handle(event, now)
        except VrError as refusal:
            self._note(event, type(refusal).__name__)
            raise
        self._note(event, effects)
        return effects

    def reload(self) -> None:
        """Go on from the encoded state: whatever else refers to the old one is left behind with it."""
        self.state = decode_state(encode_state(self.state))

    def _note(self, event: CoreEvent, result: object) -> None:
        self._world.note(self.state.address.name, type(event).__name__, zlib.crc32(_encode((event, result))))


class World:
    """See the module. Use it as a context manager; what it ran is gone afterwards, the trace stays."""

    process_class = SimulatedProcess

    def __init__(self, seed: int, *, delay: float = 0.001, lease: float = 2.0) -> None:
        """Begin with nobody.

        Args:
            seed: of everything.
            delay: [s] of a message between two processes.
            lease: [s] of silence after which a process counts as gone.
        """
        self.seed = seed
        self.runner = VirtualRunner(seed)
        self.network = MemoryNetwork(
            delay=delay, lease=lease, agenda=self.runner, chance=random.Random(f"{seed} network").random
        )
        self.network.on_message = self._message
        self.trace: list[TraceEntry] = []
        self.complaints: list[str] = []
        """Reports of event loops that nobody handles: faults, if there are any."""
        self.processes: list[SimulatedProcess] = []
        self._cores: list[TracedCore] = []
        self._keys = random.Random(f"{seed} keys")
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Self:
        if gc.isenabled():  # when it runs is no part of the seed
            gc.disable()
            self._stack.callback(gc.enable)
        self._stack.enter_context(chance.drawn_from(self._keys.getrandbits))
        self._stack.enter_context(on_clock("the World"))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for process in self.processes:
            process.alive = False
        # what is dropped in the middle of its work may not end in order, which is the fault of nobody
        told, sys.unraisablehook = sys.unraisablehook, _ignore
        level = logging.root.manager.disable
        logging.disable(logging.CRITICAL)
        try:
            self._stack.enter_context(warnings.catch_warnings(action="ignore"))
            self.runner.preemption.share = 0.0
            self.runner.close()
            self.runner.outside()
            for process in self.processes:
                process.loop.drop()
            self.processes.clear()
            self._cores.clear()
            gc.collect(0)  # what was made meanwhile: it was off
        finally:
            sys.unraisablehook = told
            logging.disable(level)
        self._stack.close()

    def start(
        self, name: str, main: Main, *, skew: float = 0.0, rate: float = 1.0, offset: float = 0.0
    ) -> SimulatedProcess:
        """Start a process.

        Args:
            name: for the trace.
            main: what it does.
            skew: [s] by which its time of day is ahead.
            rate: [s/s] of its clocks.
            offset: [s] by which its monotonic clock is ahead of the world's.
        """
        self.note(name, "started")
        process = self.process_class(self, name, main, skew=skew, rate=rate, offset=offset)
        self.processes.append(process)
        return process

    def run(self, until: float) -> None:
        """Let virtual time pass up to a moment [s].

        Raises:
            BaseException: what a process raised and nobody caught, other than a `VrError`.
        """
        self.runner.run(until)

    def note(self, who: str, what: str, details: object = "") -> None:
        """Add a line to the trace."""
        self.trace.append((self.runner.now(), who, what, details))

    def core(self, state: RobotState) -> RobotCore:
        """Make the machine of a robot (`Process`): what it does is part of the trace."""
        core = TracedCore(state, self)
        self._cores.append(core)
        return core

    def reload(self) -> None:
        """Replace the state of every robot by what is decoded from its encoding."""
        for core in self._cores:
            core.reload()

    @property
    def digest(self) -> str:
        """A short text that is the same for the same trace."""
        return hashlib.blake2b(_encode(self.trace), digest_size=16).hexdigest()

    def _message(self, source: str, target: str, what: str, key: str, body: bytes) -> None:
        self.trace.append((self.runner.now(), target, what, key, source, zlib.crc32(body)))


def _ignore(_: object) -> None:
    """Say nothing."""
