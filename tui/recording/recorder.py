"""From a living realm into a file: `robotree record FILE`.

States and log lines come by themselves; descriptions, pictures and kept events are asked for at their own
paces. The file is handed to the system once a second, so who is killed loses that second.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import time
from collections.abc import AsyncGenerator, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from robotree.tui.errors import BadRecordedRealm
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.past import kept_events
from robotree.tui.line.verbs import Outcome, Teller
from robotree.tui.recording.tape import TapeWriter
from robotree.tui.wire.lasting import Lasting, lasting

if TYPE_CHECKING:
    from robotree.vr.base.address import Address
    from robotree.vr.base.requests import LoggedLine, State
    from robotree.vr.supervision.realm_client import RealmClient

PICTURES = 2.0
"""[1/s] of each camera, when the line does not say."""

SIZE = (480, 270)
"""[px] width and height of the pictures."""

LOOK = 5.0
"""[s] at most between two questions to all robots for their descriptions."""

PAUSE = 0.4
"""[s] at least between two of them, however often something changes."""

EVENTS = 10.0
"""[s] between two questions for the kept events of those robots that have done something meanwhile."""

FLUSH = 1.0
"""[s] that a killed recorder loses at most."""

SETTLE = 0.3
"""[s] in which robots publish the last lines of their logs, and hosts write the last events."""


async def record(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Record a realm until Ctrl-C, or for a time."""
    name = line.text("FILE")
    rate = rate_of(line.text("--pictures"))
    wanted = line.many("NAME")
    for robot in wanted:  # one that nobody has would record nothing for ever
        await realm_client.describe(robot)
    file = _created(name)
    began = time.time()
    try:
        async with _written(name, file), lasting(line) as here:
            about = {"realm": realm_client.realm, "began": repr(began)}
            recorder = Recorder(realm_client, TapeWriter(file, about), here, began, wanted)
            teller.warn(f"recording realm {realm_client.realm or 'here'} into {name}; Ctrl-C ends it")
            await recorder.run(file, rate)
    finally:
        with contextlib.suppress(OSError):  # what could not be written was told already
            file.close()
    seconds = time.time() - began
    counts = {"entries": recorder.writer.entries, "pictures": recorder.pictures}
    text = f"{name}: {counts['entries']} entries, {counts['pictures']} of them pictures, in {seconds:.1f} s"
    return Outcome({"file": name, **counts, "seconds": round(seconds, 3)}, text)


def rate_of(text: str) -> float:
    """Return how many pictures a second are wanted of each camera.

    Raises:
        ValueRefused: it is no such number.
    """
    refusal = "is no number of pictures a second, from 0 (none) to 30"
    return values.ranged("RATE", text or str(PICTURES), 0.0, 30.0, refusal)


def _created(name: str) -> BinaryIO:
    try:
        file = Path(name).open("xb")  # noqa: SIM115 # it is open as long as it is recorded
    except FileExistsError:
        raise BadRecordedRealm(name, "exists already, and recordings are not overwritten") from None
    except OSError as error:
        raise BadRecordedRealm(name, f"cannot be written: {error.strerror}") from None
    with contextlib.suppress(OSError):  # a file system without locks
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # who reads it meanwhile knows that it goes on
    return file


@contextlib.asynccontextmanager
async def _written(name: str, file: BinaryIO) -> AsyncGenerator[None]:
    """Say what becomes of a file into which no more can be written."""
    try:
        yield
    except OSError as error:
        with contextlib.suppress(OSError):
            file.close()
        detail = f"cannot be written: {error.strerror}; what was written before is kept"
        raise BadRecordedRealm(name, detail) from error


class Recorder:
    """Writes what a realm says into one file."""

    def __init__(
        self,
        realm_client: RealmClient,
        writer: TapeWriter,
        here: Lasting,
        began: float,
        robots: Collection[str] = (),
    ) -> None:
        """Prepare.

        Args:
            realm_client: of the realm.
            writer: of the file.
            here: ends the recording.
            began: [s] since 1970: when it begins, as the file says.
            robots: that are recorded; empty: all. Views are recorded in any case.
        """
        self._realm_client, self.writer, self._here = realm_client, writer, here
        self._robots = frozenset(robots)
        self._known = set[tuple[str, int]]()
        """Kept events that were written: who keeps them, and their numbers there."""
        self._bonds = dict[str, "Address | None"]()
        """The parent of each robot, as its states say."""
        self._described = set[str]()
        """Robots that are there, as far as is known."""
        self._changed = asyncio.Event()
        """Set when robots should be asked for their descriptions."""
        self._stirred = set[str]()
        """Robots that have done something since their events were read."""
        self._began = began
        self.pictures = 0

    async def run(self, file: BinaryIO, rate: float) -> None:
        """Record until the end; `rate` [1/s]: of pictures of each camera.

        Raises:
            OSError: the file cannot be written.
        """
        realm_client = self._realm_client
        await self._look(self._began)
        forget = realm_client.on_change(self._changed.set)
        watching = await realm_client.watch_state(None, self._take_state)
        listening = await realm_client.watch_log(None, self._take_lines)
        tasks = [
            asyncio.create_task(self._keep(self._look_after_changes, PAUSE)),
            asyncio.create_task(self._keep(self._read_events, EVENTS)),
        ]
        if rate:
            tasks.append(asyncio.create_task(self._keep(self._take_pictures, 1.0 / rate)))
        try:
            while not self._here.over:
                self.writer.flush()
                file.flush()
                await self._here.wait(FLUSH)
            await asyncio.sleep(SETTLE)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            forget()
            await watching.close()
            await listening.close()
        self._here.exit_code()  # raises what went wrong beside the file
        await self._read_events()
        self.writer.close()
        file.flush()

    def _wanted(self, name: str) -> bool:
        return not self._robots or name in self._robots

    async def _keep(self, look: Any, pause: float) -> None:
        """Look again and again, at a pace: a look that takes longer delays the next."""
        from robotree.vr.base.errors import VrError

        while True:
            due = time.monotonic() + pause
            try:
                await look()
            except VrError:
                pass  # nobody answers at the moment: what comes by itself is recorded nevertheless
            except OSError as error:
                self._here.end(error)
                return
            await asyncio.sleep(max(due - time.monotonic(), 0.0))

    def _take_state(self, name: str, state: State) -> None:
        if self._wanted(name):
            self._write(self.writer.state, time.time(), name, state)
            if name not in self._bonds or self._bonds[name] != state.bond:
                self._bonds[name] = state.bond
                self._changed.set()

    def _take_lines(self, name: str, lines: Sequence[LoggedLine]) -> None:
        if self._wanted(name):
            self._stirred.add(name)
            for line in lines:
                self._write(self.writer.line, name, line)

    def _write(self, write: Any, *content: Any) -> None:
        """Write what came by itself: an error of the file ends the recording, not who has published it."""
        try:
            write(*content)
        except OSError as error:
            self._here.end(error)

    async def _look_after_changes(self) -> None:
        """Ask what robots are now when something has changed, and now and then."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LOOK):
                await self._changed.wait()
        self._changed.clear()
        await self._look()

    async def _look(self, unix: float = 0.0) -> None:
        """Ask what robots are now, or were at the beginning, and note which are there no more."""
        tree = [robot for robot in await self._realm_client.tree() if self._wanted(robot.name)]
        now, names = unix or time.time(), {robot.name for robot in tree}
        present = {address.name for address in self._realm_client.present("robot")}
        for robot in tree:
            self.writer.description(now, robot)
        for name in self._described - names - present:
            self.writer.gone(now, name)
            self._bonds.pop(name, None)
        self._described = (self._described & present) | names

    async def _read_events(self) -> None:
        """Ask what was kept, since the recording began, of those that have done something."""
        from robotree.vr.base.requests import ReadEvents

        for robot in sorted(self._stirred):
            self._stirred.discard(robot)
            try:
                kept = await kept_events(self._realm_client, ReadEvents(robot=robot, since=self._began))
            except BaseException:  # the recording ends meanwhile: it asks once more, then
                self._stirred.add(robot)
                raise
            for source, read in kept.answers.items():
                for numbered in read.events:
                    if (source, numbered.number) not in self._known:
                        self._known.add((source, numbered.number))
                        self.writer.event(numbered.event)

    async def _take_pictures(self) -> None:
        """Fetch one picture of each camera of each view."""
        width, height = SIZE
        for view in self._realm_client.views():
            described = await self._realm_client.describe_view(view.name)
            for camera in described.cameras:
                picture = await self._realm_client.look(view.name, camera=camera, width=width, height=height)
                self.writer.picture(time.time(), view.name, picture)
                self.pictures += 1
