"""The World on one simulated machine: its processes join their realm as real ones do, by `local.join`."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import traceback
from collections.abc import Callable, Generator
from pathlib import Path
from types import ModuleType
from typing import Protocol, Self, TypeVar

from robotree.vr.network import local
from robotree.vr.world.world import Main, SimulatedProcess, World
from tests.world.machine import Machine, SimulatedSystem
from tests.world.points import at_every_statement

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
