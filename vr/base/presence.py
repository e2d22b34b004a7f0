"""The agents that are present in a realm and those that hang: one table per process, filled by its transport.

An agent is present under its key while its process lives and is heard. All other parts of a process ask this
table, or watch it. None keeps a copy, looks a second time, or decides by a time of its own that an agent has
gone or hangs: the transport decides that, once.
"""

from __future__ import annotations

import asyncio
import itertools
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial

import msgspec

from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.newest import keep_newest
from robotree.vr.base.pattern import Handlers, Keys

LOOK = 0.05
"""[s] between two looks at processes of which it is not certain yet if they hang."""

LONGEST = 3.0
"""[s] to wait for that certainty at most: a transport has it before, see its time of silence."""

PresenceHandler = Callable[[str, bool], None]
"""Takes one change of presence: the key, and whether it is there now. Must not block."""

LEAVES = 4096
"""Agents that have taken their leave and are remembered."""

Undo = Callable[[], None]
"""Takes back what was declared. Twice is once."""


class Held(msgspec.Struct, frozen=True):
    """Something that a living process holds present, by the record that its machine keeps of it."""

    key: str
    """As announced; empty: nobody here knows what that process holds, so it may be anything."""
    where: str
    """The process that holds it, for people: `process 4711`."""
    remedy: str
    """The remedy for a person if it does not answer."""
    how: str = "which hangs"
    """How that process is if it does not answer, as a clause."""
    asleep: bool = False
    """Whether that process is stopped, as by Ctrl-Z: it cannot answer anybody."""

    @property
    def in_words(self) -> str:
        """The holder that does not answer, for people: `process 4711, which hangs`."""
        return f"{self.where}, {self.how}"


class Presence:
    """The table. May be asked from any thread; watched, and waited for, on the event loop."""

    def __init__(
        self,
        *,
        held: Callable[[str], list[Held]],
        unheard: Callable[[str], list[tuple[Held, bool]]],
        late: Callable[[str], list[Held]] = lambda _: [],
        hand_on: Callable[[Callable[[], object]], object] = lambda action: action(),
        lock: AbstractContextManager[object] | None = None,
    ) -> None:
        """Begin with nobody.

        Args:
            held: returns what the record says that is held under a pattern.
            unheard: returns what is held under a pattern by others without a sign of life, and if it is
                certain that they hang: else they may be coming, waking up, ending, or only slow.
            late: returns what is held under a pattern by others that beat late, to be shown to people.
            hand_on: calls something on the event loop, in order; from any thread.
            lock: guards the table; its holder can take it again. None: one of the operating system's.
        """
        self._held, self._unheard, self._late, self.hand_on = held, unheard, late, hand_on
        self._lock = threading.RLock() if lock is None else lock
        self._keys = Keys()
        """How many processes that are heard are present under a key, this one included."""
        self._left: dict[str, None] = {}
        """Keys of agents that have taken their leave, the oldest first."""
        self.revision = 0
        """How often the table has changed: while it is the same, so is what follows from the table."""
        self._watches = Handlers[PresenceHandler]()
        self._numbers = itertools.count()
        self._closed = False

    # -- for everybody ----------------------------------------------------------------------------

    def there(self, key: str) -> bool:
        """Whether anything is present under a key."""
        return key in self._keys

    def left(self, key: str) -> bool:
        """Whether the agent under a key has taken its leave: it said so itself, whatever came after that.

        One that is not there and has not taken its leave was lost: its process has died or hangs.
        """
        return key in self._left

    def keys(self, pattern: str) -> list[str]:
        """Return the keys under a pattern that are present, in order.

        Raises:
            TransportClosed: the transport is closed; so do all that follow.
        """
        self._check(pattern)
        with self._lock:
            return self._keys.under(pattern)

    def watch(self, pattern: str, handler: PresenceHandler) -> Undo:
        """See keys come and go: first those that are there, before this returns, then each change."""
        self._check(pattern)
        number, over = next(self._numbers), False

        def tell(key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            if not (over or self._closed):
                handler(key, there)

        def undo() -> None:
            nonlocal over
            over = True
            with self._lock:
                self._watches.remove(number)

        with self._lock:
            first = self._keys.under(pattern)
            self._watches.add(number, pattern, tell)
        for key in first:
            tell(key, True)
        return undo

    async def until(self, pattern: str, *, there: bool, within: float) -> bool:
        """Wait until anything is present under a pattern, or nothing any more.

        Args:
            pattern: of keys.
            there: which of the two.
            within: [s] to wait at most.

        Returns:
            Whether it is so.
        """
        news = asyncio.Event()
        undo = self.watch(pattern, lambda _key, _there: news.set())
        try:
            async with asyncio.timeout(within):
                while bool(self.keys(pattern)) != there:
                    news.clear()
                    await news.wait()
        except TimeoutError:
            return False
        finally:
            undo()
        return True

    async def hanging(self, pattern: str) -> list[Held]:
        """Return the agents under a pattern in processes that hang, as soon as that is certain for all.

        Presence alone cannot tell a process that hangs from one that never was, least of all to a newcomer.
        Where somebody else knows who lives, the transport compares. A process that is in doubt for `LONGEST`
        counts as one that hangs: its names are not given away, and a stop is not reported as complete.
        """
        loop, doubt = asyncio.get_running_loop(), None
        latest = loop.time() + LONGEST
        while True:
            self._check(pattern)
            found = self._unheard(pattern)
            doubtful = {one.key for one, certain in found if not certain}
            doubt = doubtful if doubt is None else doubt & doubtful  # who was heard meanwhile is only slow
            if not doubt or loop.time() > latest:
                return [one for one, certain in found if certain or one.key in doubt]
            await asyncio.sleep(LOOK)

    def hangs(self, pattern: str) -> list[Held]:
        """Return the agents under a pattern in processes that certainly hang by now, without waiting."""
        self._check(pattern)
        return [one for one, certain in self._unheard(pattern) if certain]

    def late(self, pattern: str) -> list[Held]:
        """Return the agents under a pattern in processes that are late with their sign of life.

        It is for people to see; nothing else follows from it. They come, or turn out to hang.
        """
        self._check(pattern)
        return self._late(pattern)

    def lives(self, key: str) -> bool:
        """Whether an agent is present under a key, also if its link is not up yet."""
        return self.there(key) or bool(self._unheard(key))

    def held(self, pattern: str) -> list[Held]:
        """Return what is held under a pattern by the record, heard or not. Asks no network.

        A process of which nobody here knows what it holds is among them, without a key. So is one that is
        just entering or leaving, for a moment.
        """
        self._check(pattern)
        return self._held(pattern)

    # -- for the transport ------------------------------------------------------------------------

    def count(self, key: str, *, there: bool, left: bool = False) -> None:
        """Take that one more process is present under a key, or one less. From any thread.

        Args:
            key: as announced.
            there: one more.
            left: the process itself has said that it is present under that key no longer.
        """
        with self._lock:
            self._left.pop(key, None)
            if left:
                keep_newest(self._left, key, None, LEAVES)
            if (self._keys.add if there else self._keys.remove)(key):
                self.revision += 1
                for tell in self._watches.of(key):
                    self.hand_on(partial(tell, key, there))

    def close(self) -> None:
        """Tell nothing any more, and refuse every question."""
        self._closed = True

    def _check(self, key: str) -> None:
        if self._closed:
            raise TransportClosed(key=key)
