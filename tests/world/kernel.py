"""The base of a simulated machine's files and sockets: descriptors, and faults by chance."""

from __future__ import annotations

import errno
import itertools
import random
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from robotree.vr.world.disk import fail
from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner

STANDARD = 3
"""Descriptors that every process has: its input and outputs."""

MOST_DESCRIPTORS = 1024
"""Of one process."""


@dataclass
class Trouble:
    """The faults of all processes by chance. May be changed at any time."""

    split: float = 0.0
    """Share of the sends that arrive in two pieces."""
    pause: float = 0.002
    """[s] between two pieces at most."""
    jitter: float = 0.0
    """[s] that everything is under way at most."""
    small: float = 0.0
    """Share of the connections in which there is little room."""
    full_backlog: float = 0.0
    """Share of the dials that find no place in line."""
    late_accept: float = 0.0
    """[s] that a listener learns late of a connection at most."""
    late_wake: float = 0.0
    """[s] that a thread which waits for sockets wakes late at most."""
    slow_death: float = 0.0
    """[s] between two descriptors at most that are closed when a process dies."""


class Descriptor(Protocol):
    """The object behind a descriptor's number."""

    number: int

    def release(self) -> None:
        """It is closed."""
        ...


class Kernel:
    """The state that all processes of a machine share, and its faults by chance."""

    def __init__(self, runner: VirtualRunner, seed: int) -> None:
        """Begin without trouble.

        Args:
            runner: in whose time it runs.
            seed: of its chance.
        """
        self.runner, self.random = runner, random.Random(f"{seed} machine")
        self.trouble = Trouble()
        self.calls = 0
        """System calls."""
        self.checksum = 0
        """Of all bytes that were sent, by whom, and when: equal for equal traces."""

    def call(self) -> None:
        """Somebody asks something of the machine."""
        self.calls += 1
        self.runner.point()

    def note_sent(self, pid: int, data: bytes) -> None:
        """Add what a process has sent to the checksum."""
        self.checksum = zlib.crc32(b"%d %r " % (pid, self.runner.now()) + data, self.checksum)

    def happens(self, share: float) -> bool:
        """Whether something happens that has this share; nothing is drawn if it cannot."""
        return bool(share) and self.random.random() < share

    def later(self, longest: float, action: Callable[[], object]) -> None:
        """Have something happen within some time [s]."""
        self.runner.at(self.runner.now() + self.random.random() * longest, action)


class Descriptors:
    """The open descriptors of one process."""

    def __init__(self, kernel: Kernel, process: VirtualProcess) -> None:
        """Begin with nothing open."""
        self.kernel, self.process = kernel, process
        self.descriptors: dict[int, Descriptor] = {}
        self.most_descriptors = MOST_DESCRIPTORS

    def check_descriptors(self) -> None:
        """Check that there is a free descriptor.

        Raises:
            OSError: there is none (EMFILE).
        """
        if len(self.descriptors) + STANDARD >= self.most_descriptors:
            fail(errno.EMFILE)

    def take(self, one: Descriptor) -> int:
        """Give something the lowest free descriptor.

        Raises:
            OSError: there is none (EMFILE).
        """
        self.check_descriptors()
        number = next(free for free in itertools.count(STANDARD) if free not in self.descriptors)
        self.descriptors[number] = one
        return number

    def give_back(self, number: int) -> None:
        """Close a descriptor.

        Raises:
            OSError: it is not open (EBADF).
        """
        one = self.descriptors.pop(number, None)
        if one is None:
            fail(errno.EBADF)
        one.release()
