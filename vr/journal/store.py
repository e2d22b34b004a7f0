"""Where the log of a host is kept, and who writes it: in files of this machine, or in PostgreSQL.

A log has one owner. Who takes it becomes the owner under a higher number, and from then on nothing counts
that an owner before it writes: it may only have been paused, and hold every lock that it ever had. So:

* of several that take a log after the same owner, one gets it;
* an owner writes what has happened first, and then looks if it still is the owner, before anything leaves it;
* who takes a log becomes the owner first, and then reads it.

Of what an owner has let leave, nothing is therefore missing in what the next one reads. What it sends in the
moment after its look the robots refuse: their next owner holds them under higher epochs.

`tests/vr/journal/test_log_places.py` examines any implementation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from robotree.vr.base.errors import JournalInUse


class Owner(NamedTuple):
    """The owner of a log, as others see it."""

    number: int
    """Grows with each owner, from 1."""
    host: str
    beat: int
    """Another number after each sign of life."""
    lives: bool
    """Whether its process holds the log. False: it has certainly ended, or its machine is cut off."""


class LogStore(Protocol):
    """A log that this process has taken. Used by one thread at a time, but for `expect_owner` and `beat`."""

    where: str
    """For people, without passwords."""
    name: str
    """Of the host whose log it was first."""
    size: int
    """[bytes] of the newest segment, as far as this process has written it."""
    missing: str
    """What is not there, though it was written; a clause. Empty: all is."""

    @property
    def was_full(self) -> bool:
        """Whether the last host kept nothing when it ended, for the disk took no more."""
        ...

    def frames(self, lost_power: Callable[[], bool] = lambda: False) -> Iterator[bytes]:
        """Return the bodies of all frames, the oldest first.

        Args:
            lost_power: whether the machine may have lost its power since the frames before were written.

        Raises:
            DamagedJournal: one does not fit its checksum.
            LostJournal: what was written is not there any more.
            OSError: it cannot be read.
        """
        ...

    def begin(self) -> None:
        """Begin a new segment.

        Raises:
            Deposed: here and below: another process is the owner.
            OSError: here and below: it cannot be written.
        """
        ...

    def write(self, body: bytearray) -> None:
        """Append a frame, whose head is the first bytes of `body`, to be filled in here."""
        ...

    def sync(self) -> None:
        """Return when all that was written would survive a loss of power."""
        ...

    def drop_older(self) -> None:
        """Remove all segments but the newest."""
        ...

    def clear(self) -> None:
        """Remove all segments: nothing is kept any more."""
        ...

    def expect_owner(self) -> None:
        """Return if this process is still the owner. From any thread.

        Raises:
            Deposed: it is not.
        """
        ...

    def beat(self) -> None:
        """Give a sign of life. From any thread.

        Raises:
            Deposed: another process is the owner.
        """
        ...

    def close(self) -> None:
        """Leave the log to others. Twice is once."""
        ...


class LogPlace(Protocol):
    """Where a log is, for who wants to be its owner."""

    where: str
    """For people, without passwords."""

    def look(self) -> Owner | None:
        """Return its owner; None: it never had one.

        Raises:
            OSError: nobody knows.
        """
        ...

    def take(self, host: str, after: int) -> LogStore | None:
        """Become the owner after the one of that number (0: the first), whether it lives or not.

        Returns:
            The log; None: another one has become it meanwhile.

        Raises:
            OSError: it cannot be taken.
        """
        ...

    def close(self) -> None:
        """Let go of what it uses; it can be used again."""
        ...


def own(place: LogPlace, host: str) -> LogStore:
    """Become the owner of a log that nobody holds.

    Raises:
        JournalInUse: a process holds it.
        OSError: it cannot be taken.
    """
    while True:
        owner = place.look()
        if owner is not None and owner.lives:
            raise JournalInUse(folder=place.where, host=owner.host)
        log = place.take(host, 0 if owner is None else owner.number)
        if log is not None:
            return log
