"""Real processes on which commands are interrupted: a host that ends itself where a test says, and a leaf."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine
from pathlib import Path
from typing import Any, TypeVar

from robotree.client.joining import joined
from robotree.vr.base.address import Role
from robotree.vr.base.permissions import Isolation
from robotree.vr.supervision.realm_client import RealmClient
from tests.waiting import PATIENCE

T = TypeVar("T")
HERE = Path(__file__).parent
PAGES = HERE / "pages.py"
COMPLAINT = re.compile(r"Traceback|Exception|CRITICAL|never awaited|AssertionError")


class Program:
    """One process of Python in a realm, and what it complained of in all its lives."""

    def __init__(self, folder: Path, realm: str, name: str, *words: str | Path) -> None:
        self.name, self.words = name, [str(word) for word in words]
        self.prefix: list[str] = []
        """Words before those of the process, which have it run elsewhere."""
        self.log = folder / f"{name}.err"
        self.lives = 0
        self.environment = {"ROBOTREE_REALM": realm}
        """Of each of its lives."""
        self.address = ""
        """Where it listens, if it says so when it is ready."""
        self.started: list[float] = []
        """[s] when it was started, in each life."""

    async def start(self, **environment: str) -> None:
        """Start it (again), and return when it is ready or has ended."""
        self.started.append(time.monotonic())
        with self.log.open("ab") as log:
            self.process = await asyncio.create_subprocess_exec(
                *(*self.prefix, sys.executable, *self.words),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                env={**os.environ, **self.environment, **environment},
            )
        self.lives += 1
        assert self.process.stdout is not None
        async with asyncio.timeout(PATIENCE):
            line = await self.process.stdout.readline()
            self.address = line.decode().strip().partition(" ")[2]
            if not line:
                code = await self.process.wait()
                assert code == -signal.SIGKILL, f"{self.name} ended with {code}: {self.complaints}"

    @property
    def runs(self) -> bool:
        return self.process.returncode is None

    async def kill(self, number: signal.Signals = signal.SIGKILL) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)
        async with asyncio.timeout(PATIENCE):
            await self.process.wait()

    @property
    def complaints(self) -> str:
        """What it has written to its standard error, in all lives."""
        return self.log.read_text() if self.log.exists() else ""


class Stage:
    """A realm with a leaf, whose robots write down what they do, and hosts."""

    realm_client: RealmClient

    def __init__(self, folder: Path, realm: str) -> None:
        self.folder, self.realm = folder, realm
        self.programs: list[Program] = []
        self.effects_file = folder / "effects"

    def program(self, name: str, *words: str | Path) -> Program:
        self.programs.append(Program(self.folder, self.realm, name, *words))
        return self.programs[-1]

    def host(self, name: str = "h1") -> Program:
        """Return a host that is waited for as long as a busy machine may take to start it again."""
        host = self.program(name, HERE / "host.py", name, self.folder / f"{name}.journal")
        host.environment["RETURNS"] = f"{PATIENCE:g}"
        return host

    async def furnish(
        self, host: Program, kill: str = "", *, other: str = "", level: Isolation = "none", **environment: str
    ) -> None:
        """Start a host, with a tourist and its helper on it, on top of the leaf's arms.

        Args:
            host: of both robots.
            kill: where it ends; see `host.py`.
            other: name of a host that runs, for the helper; empty: the same.
            level: how the tourist is kept apart.
            environment: of the host.
        """
        await host.start(KILL=kill, **environment)
        await self.presence("host", host.name)
        for name, kind, where in (
            ("tourist", "Tourist", host.name),
            ("helper", "Helper", other or host.name),
        ):
            isolate: Isolation = level if name == "tourist" else "none"
            await self.realm_client.create(str(PAGES), name, where, kind, isolate=isolate)
        for name in ("arm-1", "arm-2", "helper", "tourist"):
            await self.presence("robot", name)
        await self.realm_client.enslave("helper", "arm", "arm-2")
        await self.realm_client.enslave("tourist", "arm", "arm-1")
        await self.realm_client.enslave("tourist", "helper", "helper")

    async def presence(self, role: Role, name: str) -> None:
        """Wait until a process has been met that has an agent of this name."""
        async with asyncio.timeout(PATIENCE):
            while not self.realm_client.directory.present(role, name):  # noqa: ASYNC110 # a table, which tells nobody
                await asyncio.sleep(0.005)

    async def play(
        self,
        host: Program,
        command: str,
        kills: list[str],
        *,
        robot: str = "tourist",
        patience: float = PATIENCE,
        **arguments: Any,
    ) -> Any:
        """Call a command of a robot; start the host again, with the next kill, whenever it has ended."""
        calling = self.realm_client.call(robot, command, arguments, deadline=3 * patience)
        async with beside(calling, keep_alive(host, kills)) as (call, keeper):
            await asyncio.wait((call, keeper), timeout=patience, return_when=asyncio.FIRST_COMPLETED)
            if keeper.done():
                keeper.result()
            assert call.done(), f"stuck after {host.lives} lives: {self.told()}"
            return call.result()

    def begin(self, command: str, **arguments: Any) -> asyncio.Task[Any]:
        """Begin a command of the tourist."""
        return asyncio.create_task(
            self.realm_client.call("tourist", command, arguments, deadline=3 * PATIENCE)
        )

    # -- what happened ----------------------------------------------------------------------------

    @property
    def effects(self) -> list[tuple[str, str, int, str, float]]:
        """Each thing that the leaf has done: word, robot, number, key and time [s]."""
        if not self.effects_file.exists():
            return []
        lines = [line.split() for line in self.effects_file.read_text().splitlines()]
        return [(word, robot, int(n), key, float(at)) for word, robot, n, key, at in lines]

    @property
    def ended(self) -> list[int]:
        return sorted(n for word, _, n, _, _ in self.effects if word == "end")

    def twice(self) -> list[str]:
        """Return what was begun more than once, by key and by number."""
        begun = [(key, n) for word, _, n, key, _ in self.effects if word == "begin"]
        keys, numbers = Counter(key for key, _ in begun), Counter(n for _, n in begun)
        return [*(key for key, n in keys.items() if n > 1), *(str(n) for n, m in numbers.items() if m > 1)]

    def expect_once(self, *numbers: int) -> None:
        """Hold that exactly these things were done, each once, and that nobody complained."""
        assert self.twice() == []
        assert self.ended == sorted(numbers)
        self.expect_silence()

    def expect_silence(self) -> None:
        assert not COMPLAINT.search(self.told()), self.told()

    def told(self) -> str:
        return "\n".join(f"{each.name}: {each.complaints}" for each in self.programs)

    async def until_effects(self, count: int, word: str = "end") -> None:
        """Wait until the leaf has done so much."""
        latest = time.monotonic() + PATIENCE
        while sum(each[0] == word for each in self.effects) < count:
            assert time.monotonic() < latest, f"{self.effects}\n{self.told()}"
            await asyncio.sleep(0.005)


def in_folder(play: Callable[[Path], Coroutine[Any, Any, T]]) -> T:
    """Play trials in a folder of their own, with all that robotree keeps; return what comes of it."""
    with tempfile.TemporaryDirectory(prefix="rt-") as name:
        folder = Path(name)
        for variable in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME"):
            path = folder / variable[4:7].lower()
            path.mkdir(mode=0o700)
            os.environ[variable] = str(path)
        return asyncio.run(play(folder))


@contextlib.asynccontextmanager
async def beside(*work: Coroutine[Any, Any, Any]) -> AsyncIterator[list[asyncio.Task[Any]]]:
    """Have some work go on beside the block; its end ends it."""
    tasks = [asyncio.create_task(each) for each in work]
    try:
        yield tasks
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def keep_alive(host: Program, kills: list[str]) -> None:
    """Start a host again whenever it ends, with the next kill."""
    while True:
        await host.process.wait()
        assert host.process.returncode == -signal.SIGKILL, host.complaints
        await host.start(KILL=kills.pop(0) if kills else "")


@contextlib.asynccontextmanager
async def staged(folder: Path, realm: str = "durable") -> AsyncIterator[Stage]:
    """Start the leaf, and end everything afterwards."""
    stage = Stage(folder, realm)
    try:
        await stage.program("leaf", HERE / "leaf.py", stage.effects_file, "arm-1", "arm-2").start()
        async with joined(realm) as realm_client:
            stage.realm_client = realm_client
            yield stage
    finally:
        for program in stage.programs:
            if program.lives:
                await program.kill()
