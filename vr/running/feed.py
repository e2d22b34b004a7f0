"""The readings of children as one running command follows them: it waits for new ones, or for a condition."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from msgspec.structs import replace

from robotree.vr.author.context import CallLimit, WhichValue
from robotree.vr.author.readings import Record
from robotree.vr.base.errors import NotPermitted, VrError
from robotree.vr.base.requests import State, StreamSample
from robotree.vr.running.frame import Frame

MOST_KEPT = 100
"""Values of a stream that are kept until a command reads them."""

_numbers = itertools.count(1)


class NoReadingYet(BaseException):
    """Nothing has been published yet; no `Exception`, so that a condition of a page does not catch it."""


class Feed:
    """The publications of the child in one slot. Its methods may be called in any thread."""

    number: int = 0
    """Of the latest news, counted over all feeds of the process; 0: there was none."""
    over: bool = False
    """Whether the child has left the slot."""
    latest: Record | None = None
    """The latest readings; None: there were none."""
    state: State | None = None
    """The latest state, of which they are a part; None: there was none."""

    def __init__(self, frame: Frame, slot: str, stream: str = "") -> None:
        """Follow the child that is in a slot now, or a stream of the robot that is watched, for a command.

        Raises:
            SlotEmpty: there is none.
            NotPermitted: the page may see no reading of it.
        """
        self.unread: deque[tuple[int, Any]] = deque(maxlen=MOST_KEPT)
        """Values of the stream that the command has not read yet, with their numbers."""
        self.newest: tuple[int, Any] | None = None
        """The newest value of the stream."""
        runtime = frame.runtime
        child, epoch = runtime.child_in(slot)
        self._may = runtime.permissions
        self._kinds: tuple[str, ...] = () if self._may is None else runtime.kinds_in(slot)
        if self._may is not None:
            kind = next(iter(self._kinds), slot)
            if not self._may.may_read_any(self._kinds):
                raise NotPermitted(robot=runtime.name, what=f"see readings of {kind}")
            if stream and not self._may.may_read(self._kinds, stream):
                raise NotPermitted(robot=runtime.name, what=f"see {stream} of {kind}")
        self._wake = frame.wake
        self._forget = runtime.when_gone(slot, self._end)
        self._unfollow = runtime.follow_child(child, f"stream/{stream}" if stream else "state", self._take)
        try:
            gone = runtime.child_in(slot) != (child, epoch)
        except VrError:
            gone = True
        if gone:  # it has left before it was followed
            self._end(None)

    def _take(self, news: State | StreamSample) -> None:
        number = next(_numbers)
        if isinstance(news, State):
            if (may := self._may) is not None:
                seen = {name: one for name, one in news.readings.items() if may.may_read(self._kinds, name)}
                news = replace(news, readings=seen)
            self.state, self.latest = news, Record(news.readings)
        else:
            self.newest = number, news.value
            self.unread.append(self.newest)
        self.number = number
        self._wake()

    def sample(self, which: WhichValue, after: int) -> tuple[int, Any] | None:
        """Take a value of the stream; None: there is none yet. In the command's thread only.

        Args:
            which: see `Activity.next_sample`.
            after: number that it must be above.
        """
        found = self.newest
        if which == "each":
            with contextlib.suppress(IndexError):
                return self.unread.popleft()
            return None
        if found is None or (which == "next" and found[0] <= after):
            return None
        if which == "newest" and not self.unread:
            return None
        self.unread.clear()
        return found

    def has_news(self, after: int) -> bool:
        """Whether there is news that is newer than the one numbered `after`."""
        return self.number > after

    def _end(self, _: VrError | None) -> None:
        """Take note that the child has left the slot."""
        self.over, self.number = True, next(_numbers)
        self._wake()

    def close(self) -> None:
        """Follow the child no more."""
        self._forget()
        self._unfollow()


class Feeds:
    """The readings of children that one command follows."""

    def __init__(self, frame: Frame) -> None:
        """Follow nobody yet; `frame` is that of the command."""
        self._frame = frame
        self._by_slot: dict[tuple[str, str], Feed] = {}

    def of(self, slot: str, stream: str = "") -> Feed:
        """Return what the child that is now in a slot publishes: its state, or a stream.

        Raises:
            SlotEmpty: there is none.
        """
        feed = self._by_slot.get((slot, stream))
        if feed is None or (feed.over and not feed.unread):
            if feed is not None:
                feed.close()
            feed = self._by_slot[slot, stream] = Feed(self._frame, slot, stream)
        return feed

    def next_sample(self, slot: str, stream: str, which: WhichValue, limit: CallLimit | None) -> Any:
        """Wait for a value of a stream; see `Activity.next_sample`.

        Raises:
            TimeoutError: none came in time.
            SlotEmpty: nobody is watched.
        """
        now = self._frame.worker.now
        end = math.inf if limit is None else now() + limit.seconds
        feed = self.of(slot, stream)
        began = feed.number
        while (found := feed.sample(which, began)) is None:
            if not self._frame.wait(partial(feed.has_news, feed.number), end - now()):
                text = limit.text if limit else ""
                raise TimeoutError(f"nothing came from {slot}.{stream} within {text}")
            feed = self.of(slot, stream)
        return found[1]

    def next_reading(self, slot: str, after: int) -> tuple[int, Any]:
        """Wait for a reading that is newer than the one numbered `after`; return its number, too."""
        feed = self.of(slot)
        while feed.over or feed.number <= after:
            self._frame.wait(partial(feed.has_news, after))
            feed = self.of(slot)
        return feed.number, feed.latest

    def wait_until(self, condition: Callable[[], object], limit: CallLimit | None) -> None:
        """Wait until a condition of the page is true; look at it again whenever a child publishes.

        Raises:
            TimeoutError: it was not true in time.
            RuntimeError: it reads nothing of a child.
        """
        frame = self._frame
        end = math.inf if limit is None else frame.worker.now() + limit.seconds
        frame.looks = True
        try:
            while True:
                newest = self._newest()
                if self._holds(condition):
                    return
                if not self._by_slot:
                    raise RuntimeError(
                        "the condition of wait_until has read no readings of a child, so nothing tells when "
                        "to look again; read them as in self.arm.readings.z"
                    )
                if not frame.wait(partial(self._has_news, newest), end - frame.worker.now()):
                    raise TimeoutError(f"the condition was not true within {limit.text if limit else ''}")
        finally:
            frame.looks = False

    def _holds(self, condition: Callable[[], object]) -> bool:
        worker = self._frame.worker
        worker.arm(self._frame)
        try:
            return bool(condition())
        except NoReadingYet:
            return False
        finally:
            worker.disarm()

    def _newest(self) -> int:
        return max((feed.number for feed in self._by_slot.values()), default=0)

    def _has_news(self, after: int) -> bool:
        return self._newest() > after

    def close(self) -> None:
        """Follow nobody any more."""
        for feed in self._by_slot.values():
            feed.close()
