"""A host in a process of its own that ends itself, by SIGKILL, at a place that the test has chosen.

    host.py NAME FOLDER

`$KILL` is `PLACE NUMBER`: the how manieth moment of that kind is its last one; empty: it lives on. Moments
count from the first command that is called by a person, or from the start if there is one already. SIGTERM
ends it in order. It says `ready` when its robots are back.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from robotree.vr.agents import run
from robotree.vr.agents.moving import Moves
from robotree.vr.core import events as on
from robotree.vr.journal import segments
from robotree.vr.journal.files import FilePlace
from robotree.vr.journal.journal import HostJournal
from robotree.vr.running.frame import Frame

NAME, FOLDER = sys.argv[1], Path(sys.argv[2])
PLACE, _, NUMBER = os.environ.get("KILL", "").rpartition(" ")
HANGS = "HANGS" in os.environ
"""Whether it is stopped at that place, and not killed."""


class Countdown:
    """Counts the moments of the chosen kind."""

    def __init__(self) -> None:
        self.armed, self._lock = FOLDER.exists(), threading.Lock()
        self._left = int(NUMBER or -1)

    def here(self, place: str, before: Callable[[], object] = lambda: None) -> None:
        if place != PLACE or not self.armed:
            return
        with self._lock:
            self._left -= 1
            if self._left == 0:
                before()
                os.kill(os.getpid(), signal.SIGSTOP if HANGS else signal.SIGKILL)


countdown = Countdown()


class Disk(segments.OSDisk):
    """The disk, with moments before, in the middle of, and after each write."""

    def write(self, descriptor: int, data: bytes | bytearray) -> int:
        countdown.here("before write")
        countdown.here("torn write", lambda: os.write(descriptor, data[: max(1, len(data) * 2 // 3)]))
        written = super().write(descriptor, data)
        countdown.here("after write")
        return written


class Journal(HostJournal):
    """The journal on that disk, with a moment after each record."""

    def append(self, robot: str, now: float, event: on.CoreEvent) -> None:
        if isinstance(event, on.Invoke) and not event.call.source and not event.reads:
            countdown.armed = True
        super().append(robot, now, event)
        if isinstance(event, on.StepTaken):
            countdown.here("after step")
        if isinstance(event, on.Finish):
            countdown.here("after end")

    def begin(self) -> None:
        countdown.here("before segment")
        super().begin()


class Door:
    """A transport, with moments around each call of a robot in another process."""

    def __init__(self, transport: Any) -> None:
        self._transport = transport

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def ask(self, key: str, body: bytes, *, on_reply: Callable[[Any], None], **options: Any) -> None:
        if b"act" not in body:
            return self._transport.ask(key, body, on_reply=on_reply, **options)

        def hear(reply: Any) -> None:
            countdown.here("reply came")
            on_reply(reply)
            countdown.here("reply taken")

        countdown.here("before send")
        self._transport.ask(key, body, on_reply=hear, **options)
        return countdown.here("after send")


def prepare() -> None:
    recalled = Frame.recalled

    def look(frame: Frame, path: str, kind: str, content: Any = None) -> Any:
        step = recalled(frame, path, kind, content)
        if step is not None:
            countdown.here("replay")
        return step

    Frame.recalled = look  # type: ignore[method-assign]
    join = run.join

    async def enter(realm: str | None) -> Any:
        return Door(await join(realm))

    Moves.moment = staticmethod(lambda place: countdown.here(f"move {place}"))
    run.join = enter  # type: ignore[assignment]
    run.HostJournal = Journal  # type: ignore[misc]


@contextlib.asynccontextmanager
async def until_sigterm() -> AsyncIterator[None]:
    task = asyncio.current_task()
    assert task is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        yield


def keeping() -> run.Keeping:
    """Where it keeps its robots: in `$JOURNAL`, a database, or in its folder."""
    of, url = os.environ.get("STANDBY_FOR", ""), os.environ.get("JOURNAL", "")
    place = (
        run.place_of(FOLDER, url, os.environ.get("LOG", of or NAME))
        if url
        else FilePlace(FOLDER, Disk(), run._boot())
    )
    assert place is not None
    return run.Keeping(place, of, float(os.environ.get("AFTER", "3")))


async def main() -> None:
    async with until_sigterm():
        await run.run_host(
            NAME,
            keep=keeping(),
            past=FOLDER,
            returns=float(os.environ.get("RETURNS", "10")),
            ready=lambda _: os.write(1, b"ready\n") and None,
        )


if __name__ == "__main__":
    prepare()
    asyncio.run(main())
