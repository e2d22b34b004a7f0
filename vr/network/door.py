"""The socket on which a process listens, and the connections that have not said hello yet.

What has not said hello is bounded in number, size and time, so that no program can take the memory, the
descriptors or the time of this process by connecting to it. Where a bound is passed, the oldest connection of
the process that has the most is closed; the kernel says whose they are. A process of ours that loses one so
connects again.

Some descriptors are kept in reserve. Where no other one is free, a connection takes one of these, so that a
stop is still accepted. If all of them are taken and another connection waits, the oldest of those that came
by the reserve makes room.
"""

from __future__ import annotations

import contextlib
import errno
from collections import Counter
from collections.abc import Callable
from typing import Final

from robotree.vr.base.system import THIS_SYSTEM, Socket, System
from robotree.vr.network.link import LONGEST_HELLO, PeerLink
from robotree.vr.network.readers import Sockets
from robotree.vr.network.refusals import RefusalKind, Refusals

WITHIN: Final = 5.0
"""[s] in which a connection must have said hello."""

MOST_OF_ONE: Final = 64
"""Connections of one process that have not said hello."""

MOST_OF_ALL: Final = 256
"""Connections of all processes that have not said hello."""

MOST_BYTES: Final = 4 * LONGEST_HELLO
"""[bytes] of greetings that are not complete, of all processes; of one process: `LONGEST_HELLO`."""

AT_ONCE: Final = 64
"""Connections that are accepted before others are read."""

RESERVE: Final = 4
"""Descriptors in reserve: `robotree stop` needs one connection at first, and two later."""

STAY: Final = 0.5
"""[s] that a connection which came by the reserve stays at least."""

_NONE_FREE: Final = {errno.EMFILE, errno.ENFILE}


class Door:
    """See the module. Used in the thread that reads."""

    def __init__(
        self,
        listening: Socket,
        sockets: Sockets,
        *,
        wrap: Callable[[Socket], PeerLink],
        close: Callable[[PeerLink], None],
        refusals: Refusals,
        admits: Callable[[Socket], bool] | None = None,
        clock: Callable[[], float] | None = None,
        system: System = THIS_SYSTEM,
    ) -> None:
        """Open it.

        Args:
            listening: the socket; it is the door's from now on.
            sockets: in which it, and what it accepts, is waited for.
            wrap: makes a link of a connection.
            close: ends a link; it calls `closed`.
            refusals: takes what was refused.
            admits: whether who has connected belongs here; None: who is of this user does.
            clock: [s]; None: the system's.
            system: of the sockets.
        """
        self._listening, self._sockets = listening, sockets
        self._wrap, self._close, self._refusals = wrap, close, refusals
        self._system, self._clock = system, clock or system.now
        self._admits = admits
        self._strange: dict[PeerLink, float] = {}
        """Links that have not said hello, the oldest first, and when they came [s]."""
        self._of = Counter[int]()
        """How many of these each process has."""
        self._reserve: list[int] = []
        self._lent: dict[PeerLink, float] = {}
        """Links that came by the reserve, the oldest first, and when they came [s]."""
        self._waits = False
        """Whether connections wait for which there is no descriptor."""
        self._fill_reserve()
        sockets.add(listening, self.accept)

    def accept(self) -> None:
        """Accept some of the connections that wait; what they have said is read before the next ones."""
        for _ in range(AT_ONCE):
            if not self._accept_one():
                return
        self._look_again()

    def accept_all(self) -> None:
        """Accept all that wait, before this door is closed for another one: a stop may be among them."""
        while self._accept_one():
            pass

    def introduced(self, link: PeerLink) -> None:
        """A link has said hello."""
        if self._strange.pop(link, None) is not None:
            process = link.far_end.process
            self._of[process] -= 1
            if not self._of[process]:
                del self._of[process]

    def came(self, link: PeerLink) -> None:
        """Something has come on a link that has not said hello."""
        if link.incomplete and link in self._strange:
            self._keep_bounds(link)

    def closed(self, link: PeerLink) -> None:
        """A link has been closed: its descriptor may be needed."""
        self.introduced(link)
        self._lent.pop(link, None)
        if len(self._reserve) < RESERVE or self._waits:
            self._make_room()

    def tick(self) -> None:
        """Close those that have not said hello in time, and take in those that wait."""
        now = self._clock()
        for link in [link for link, since in self._strange.items() if now - since > WITHIN]:
            self._refuse(link, "silent", f"has not said who it is within {WITHIN:g} s")
        if self._waits and not self._reserve:
            for link in [link for link, since in self._lent.items() if now - since > STAY][:1]:
                self._close(link)
        if len(self._reserve) < RESERVE or self._waits:
            self._make_room()

    def close(self) -> None:
        """Close the socket, and give the reserve back. Links are closed by their owner."""
        self._sockets.remove(self._listening)
        self._listening.close()
        reserve, self._reserve = self._reserve, []
        for descriptor in reserve:
            self._system.close(descriptor)

    # -- inside -----------------------------------------------------------------------------------

    def _accept_one(self) -> bool:
        """Accept a connection that waits; returns whether there was one, and a descriptor for it."""
        with self._system.opening:
            lent = len(self._reserve)
            line = self._next()
            if line is None:
                return False
            link = self._wrap(line)
            own = link.far_end.user == self._system.user()
            if not (own if self._admits is None else self._admits(line)):
                user = link.far_end.user
                link.close()
                self._fill_reserve()
                text = f"a process of user {user} tried to enter the realm; it was refused"
                self._refusals.note("user", text)
                return True
            self._sockets.add(line, link)
        self._strange[link] = self._clock()
        self._of[link.far_end.process] += 1
        if len(self._reserve) < lent:
            self._lent[link] = self._clock()
        self._keep_bounds(link)
        return True

    def _next(self) -> Socket | None:
        """Return the next connection that waits; None: there is none, or no descriptor for it."""
        while True:
            try:
                return self._listening.accept()[0]
            except OSError as error:
                if error.errno == errno.ECONNABORTED:
                    continue
                self._waits = error.errno in _NONE_FREE
                if not self._waits:
                    return None
                self._refusals.note(
                    "descriptors",
                    "this process has no free file descriptor, so that others cannot connect to it; "
                    f"see what holds them (`ls -l /proc/{self._system.pid()}/fd`), or raise `ulimit -n`",
                )
                if not self._reserve:
                    return None
                self._system.close(self._reserve.pop())

    def _make_room(self) -> None:
        """Fill the reserve again, and look again at what waits."""
        self._fill_reserve()
        if self._waits and self._reserve:
            self._waits = False
            self._look_again()

    def _look_again(self) -> None:
        """Have what waits reported again, behind all that has come meanwhile."""
        self._sockets.change(self._listening, writes=False)

    def _fill_reserve(self) -> None:
        with contextlib.suppress(OSError), self._system.opening:
            while len(self._reserve) < RESERVE:
                self._reserve.append(self._system.null())

    def _keep_bounds(self, link: PeerLink) -> None:
        """Close what is too much, after a link came or has said more."""
        process = link.far_end.process
        if self._of[process] > MOST_OF_ONE:
            text = f"has more than {MOST_OF_ONE} connections and says nothing on them"
            self._refuse(self._oldest(process), "crowd", text)
        if link.incomplete and self._bytes(process) > LONGEST_HELLO:
            self._refuse(link, "crowd", f"greets with more than {LONGEST_HELLO} bytes")
        while len(self._strange) > MOST_OF_ALL or (link.incomplete and self._bytes() > MOST_BYTES):
            self._refuse(self._greediest(), "crowd", "and others have too many connections and say nothing")

    def _bytes(self, process: int | None = None) -> int:
        """Return how much of greetings has come of a process, or of all [bytes]."""
        return sum(link.incomplete for link in self._strange if process in {None, link.far_end.process})

    def _oldest(self, process: int) -> PeerLink:
        return next(link for link in self._strange if link.far_end.process == process)

    def _greediest(self) -> PeerLink:
        """Return the oldest link of the process that takes the most."""
        each = Counter(self._of)
        for link in self._strange:
            each[link.far_end.process] += link.incomplete * MOST_OF_ALL // MOST_BYTES
        return self._oldest(max(each, key=each.__getitem__))

    def _refuse(self, link: PeerLink, kind: RefusalKind, why: str) -> None:
        self._refusals.note(kind, f"process {link.far_end.process} {why}; it is disconnected")
        self._close(link)
