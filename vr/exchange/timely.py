"""What begins something begins while somebody waits for it, or not at all.

What was asked of a process that hangs lies in its socket and is read when it wakes, however long ago its
asker gave up. So such a request says when it was asked, on the clock that all processes of a machine have in
common, and for how long it holds; and whoever asks one that hangs does not give up before that time is over.
From another machine, or without these words, a request is as new as its arrival.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager
from functools import cache
from pathlib import Path

from robotree.vr.errors import NoAnswer, Unreachable, VrError
from robotree.vr.requests import Begins, Request, Timely, encode
from robotree.vr.transport import Transport

FRESH = 3.0
"""[s] for which a request holds at most: longer than a slow way takes, and than it takes to see that a
process hangs, so that who gives up has little to wait."""

_simulated = ""
"""The simulated machine that this process stands for; empty: a real one."""


class Question:
    """A request as it is sent."""

    def __init__(self, request: Request, *, within: float) -> None:
        """Pack it, now.

        Args:
            request: the question.
            within: [s] for which the asker waits for the first answer.
        """
        self._void_at: float | None = None
        """[s] when nobody carries it out any more; None: it begins nothing, or nobody can tell its age."""
        self.body = encode(request)
        if isinstance(request, Begins) and (boot := boot_here()):
            asked, holds = _now(), min(within, FRESH)
            self._void_at = asked + holds
            self.body = encode(Timely(request=request, asked=asked, holds=holds, boot=boot))

    @asynccontextmanager
    async def outlived(self, transport: Transport, key: str) -> AsyncGenerator[None]:
        """Let `Unreachable` out of the block only when nobody can carry the request out any more.

        It takes longer only if whoever serves `key` has not ended but hangs.
        """
        try:
            yield
        except Unreachable:
            with contextlib.suppress(VrError):
                if self._void_at is not None and await transport.silent(key):
                    await asyncio.sleep(self._void_at - _now())
            raise


def opened(request: Request | Timely, who: str, now: float, boot: str) -> Request:
    """Return what is asked of `who`, at `now` [s] since the boot that `boot_here` names.

    Raises:
        NoAnswer: too late: its asker has given up, or is about to.
    """
    if not isinstance(request, Timely):
        return request
    if request.boot == boot and now - request.asked >= request.holds:
        raise NoAnswer(key=who, seconds=request.holds)
    return request.request


def boot_here() -> str:
    """Which boot of which machine this is: the clocks of others are not to be compared with its own."""
    return _simulated or _boot_of_this_machine()


@contextlib.contextmanager
def on_machine(boot: str) -> Generator[None]:
    """Have all processes inside the block run on one simulated machine, whose clock is in virtual time."""
    global _simulated  # noqa: PLW0603 # one machine at a time
    before, _simulated = _simulated, boot
    try:
        yield
    finally:
        _simulated = before


@cache
def _boot_of_this_machine() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""


def _now() -> float:
    """[s] since the machine's boot, in all its processes: asyncio's loops count so."""
    return asyncio.get_running_loop().time()
