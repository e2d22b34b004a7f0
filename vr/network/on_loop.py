"""From the threads of a network to an event loop, and what a transport needs on that loop.

The loop takes what it is given in order. A flood of requests would therefore stand before the next lease
renewal, however far ahead that one came over the wire (`bench/urgent.py`): `LoopTurns` does what is urgent
first, and everything else a few at a time. `SampleInbox` brings samples and presence to one handler;
`Replies` are the replies to one request, as an iterator.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextvars import Context
from functools import partial
from typing import Generic, Self, TypeVar

from robotree.vr.base.errors import NoAnswer, TransportClosed, Unreachable, VrError
from robotree.vr.base.principal import Credentials
from robotree.vr.base.transport import ELSEWHERE, End, Incoming, OnReply, RequestHandler, Respond, TakeRequest

SHARE = 32
"""Things that are not urgent done in one go; then the loop's own tasks have a turn."""

FOREVER = 7 * 24 * 3600.0
"""[s] for replies for which the asker sets no limit."""

T = TypeVar("T")

_log = logging.getLogger(__name__)


class LoopTurns:
    """Takes things to do in any thread, and does them on the event loop."""

    def __init__(self) -> None:
        """Begin with nothing to do, on the running loop."""
        self._loop = asyncio.get_running_loop()
        self._urgent: deque[Callable[[], object]] = deque()
        self._others: deque[Callable[[], object]] = deque()
        self._called = False

    def put(self, action: Callable[[], object], *, urgent: bool = False) -> bool:
        """Have something done; things of one urgency in their order. From any thread, never blocks.

        Returns:
            Whether it will be done; False: the loop is closed.
        """
        (self._urgent if urgent else self._others).append(action)
        if self._called:
            return True
        self._called = True
        try:
            # not in that of a command whose thread puts it: no thread of the loop works for one
            self._loop.call_soon_threadsafe(self._take_turn, context=Context())
        except RuntimeError:
            self._called = False
            return False
        return True

    def _take_turn(self) -> None:
        self._called = False  # before the last look, so that what comes now calls again
        for _ in range(SHARE):
            while self._urgent:
                self._do(self._urgent.popleft())
            if not self._others:
                return
            self._do(self._others.popleft())
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon(self._take_turn)

    def _do(self, action: Callable[[], object]) -> None:
        try:
            action()
        except Exception:  # noqa: BLE001 # one thing's fault is not the others'
            _log.exception("what the network brought failed")


class SampleInbox(Generic[T]):
    """Takes items in any thread, hands them on the event loop to one handler.

    However many wait, they take one place among the turns: others come between any two of them.
    """

    def __init__(self, turns: LoopTurns, handler: Callable[[T], object], limit: int | None = None) -> None:
        """Hand items to `handler` at their turn; of more than `limit` that wait, the oldest are lost."""
        self._turns = turns
        self._handler: Callable[[T], object] | None = handler
        self._items: deque[T] = deque(maxlen=limit)
        self._in_line = False

    def put(self, item: T) -> None:
        """Take an item. From any thread, at any time, even when the loop is long over; never blocks."""
        self._items.append(item)
        self._line_up()

    def close(self) -> None:
        """Hand on nothing any more."""
        self._handler = None
        self._items.clear()

    def _line_up(self) -> None:
        if not self._in_line:
            self._in_line = True
            if not self._turns.put(self._take_turn):
                self._items.clear()  # the loop is closed

    def _take_turn(self) -> None:
        self._in_line = False  # before the last look, so that an item which comes now lines up again
        handler = self._handler
        if handler is None or not self._items:
            return
        item = self._items.popleft()
        if self._items:
            self._line_up()
        handler(item)


class Replies:
    """Filled by a transport on its event loop, emptied by the asker. May be abandoned at any time."""

    def __init__(self, key: str, timeout: float) -> None:
        """Start the clock: `timeout` seconds [s] from now on for the whole exchange with `key`."""
        self.key = key
        self._seconds = timeout
        self._loop = asyncio.get_running_loop()
        self._deadline = self._loop.time() + timeout
        self._bodies: deque[bytes] = deque()
        self._answered = False
        self._ended = False
        self._error: VrError | None = None
        self._news: asyncio.Future[None] | None = None

    def feed(self, body: bytes) -> None:
        """Add a reply."""
        if not self._ended:
            self._answered = True
            self._bodies.append(body)
            self._tell()

    def end(self) -> None:
        """There will be no more; if there was none at all, nobody was there."""
        self._finish(None if self._answered else Unreachable(key=self.key))

    def time_out(self) -> None:
        """The time is over, and the other side neither ended nor died."""
        self._finish(NoAnswer(key=self.key, seconds=self._seconds))

    def shut(self) -> None:
        """This side has closed its transport."""
        self._finish(TransportClosed(key=self.key))

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> bytes:
        while not self._bodies and not self._ended:
            await self._wait()
        if self._bodies:
            return self._bodies.popleft()
        error, self._error = self._error, None
        if error is not None:
            raise error
        raise StopAsyncIteration

    async def _wait(self) -> None:
        self._news = self._loop.create_future()
        timer = self._loop.call_at(self._deadline, self.time_out)
        try:
            await self._news
        finally:
            timer.cancel()
            self._news = None

    def _finish(self, error: VrError | None) -> None:
        if not self._ended:
            self._ended, self._error = True, error
        self._tell()

    def _tell(self) -> None:
        if self._news is not None and not self._news.done():
            self._news.set_result(None)


async def relay(replies: AsyncIterator[bytes], on_reply: OnReply) -> None:
    """Hand on the replies to a request as `Transport.ask` does."""
    with contextlib.suppress(VrError):
        async for reply in replies:
            on_reply(reply)
    on_reply(None)


def answered(
    handler: RequestHandler, body: bytes, respond: Respond, end: End, key: str
) -> asyncio.Future[None] | None:
    """Have a handler answer a request, on the event loop.

    What it says before it returns None goes out together with the end of the replies.

    Returns:
        The task that answers, if there is no whole answer yet.
    """
    said: list[bytes] = []
    say: Respond = said.append

    def reply(one: bytes) -> None:
        say(bytes(one))

    def over(task: asyncio.Future[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            _log.error("the handler of %s raised", key, exc_info=error)
        end(None)

    try:
        rest = handler(body, reply)
    except Exception:  # noqa: BLE001 # the contract: logged, and the reply ends
        _log.exception("the handler of %s raised", key)
        rest = None
    last = said.pop() if said and rest is None else None
    for one in said:
        respond(one)
    if rest is None:
        end(last)
        return None
    say = respond
    task = asyncio.ensure_future(rest)
    task.add_done_callback(over)
    return task


def handled(take: TakeRequest, sender: Credentials) -> RequestHandler:
    """Return a handler for what takes requests, where each has come to the event loop already.

    Args:
        take: as served.
        sender: who has sent them.
    """

    async def handle(body: bytes, respond: Respond) -> None:
        loop, over = asyncio.get_running_loop(), asyncio.Event()

        def soon(action: Callable[[], object]) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody waits
                loop.call_soon_threadsafe(action, context=Context())

        def end(last: bytes | None) -> None:
            if last is not None and last is not ELSEWHERE:
                soon(partial(respond, last))
            soon(over.set)

        later: list[RequestHandler] = []
        take(Incoming(body, sender, lambda reply: soon(partial(respond, reply)), end, later.append))
        if not later:
            await over.wait()
        elif (rest := later[0](body, respond)) is not None:
            await rest

    return handle
