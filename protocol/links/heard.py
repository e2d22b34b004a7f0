"""The newest signing time that a controller has accepted: a small file beside the key.

Two records, each with a checksum. The first has the newest timestamp exactly, and is written with each frame
that is accepted: after `kill -9` it is all there, because the system keeps what was written, but a power cut
may lose it. So it counts only while the machine has not been started again. The second has a time ahead that
nothing accepted exceeds; it is written to the disk for good before that time is reached, and counts after a
power cut.
"""

from __future__ import annotations

import fcntl
import logging
import os
import struct
from pathlib import Path
from typing import Any, Final
from zlib import crc32

from robotree.files import opened, own
from robotree.protocol.errors import KeyFileError
from robotree.protocol.links.keyring import PERSIST_PERIOD
from robotree.protocol.signing import UNITS, HeardTime

_log = logging.getLogger(__name__)

RESERVE: Final = 2 * int(PERSIST_PERIOD * UNITS)
"""How far ahead the second record is: two periods between two writes."""
_EXACT: Final = struct.Struct("<Q36s")
"""Newest timestamp, and the machine's present life."""
_AHEAD: Final = struct.Struct("<Q")
_CHECK: Final = struct.Struct("<I")
_AHEAD_AT: Final = 512
"""[bytes] from the beginning: a disk writes 512 bytes as one."""


class HeardFile(HeardTime):
    """The newest signing time that a controller has accepted, in a file.

    Args:
        path: of the file; made if there is none.

    Raises:
        KeyFileError: it cannot be used, or another process has it: that one is the controller of this name.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._life = path, _life()
        try:
            self._file = opened(path, os.O_RDWR | os.O_CREAT | own(path))
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            problem = "another process is the controller of this name; end it, or give this one another name"
            raise KeyFileError(path, f"{problem} (?controller=NAME)") from None
        except OSError as error:
            raise KeyFileError(path, f"cannot be used: {error.strerror}") from error
        self._complained = False
        self.newest = self._ahead = self._read()

    def note(self, timestamp: int) -> None:
        """A timestamp is accepted that is later than all before."""
        super().note(timestamp)
        self._put(_EXACT.pack(timestamp, self._life), 0)
        if timestamp > self._ahead:  # of a sender whose clock is ahead: once in `RESERVE` of its time
            self.reserve(timestamp)

    def reserve(self, now: int) -> None:
        """Write a time for good that nothing accepted exceeds until the next call; takes as long as the disk.

        Args:
            now: our signing time.
        """
        self._ahead = max(self.newest, now) + RESERVE
        self._put(_AHEAD.pack(self._ahead), _AHEAD_AT)
        try:
            os.fsync(self._file)
        except OSError as error:
            self._complain(error)

    def close(self) -> None:
        """Leave the file to the next controller of this name."""
        os.close(self._file)

    def _put(self, record: bytes, at: int) -> None:
        try:
            os.pwrite(self._file, record + _CHECK.pack(crc32(record)), at)
        except OSError as error:  # a full disk must not keep a stop from being heard
            self._complain(error)

    def _complain(self, error: OSError) -> None:
        if not self._complained:
            problem = f"{self._path} cannot be written ({error.strerror})"
            _log.warning("%s; after a restart recordings are refused by the clock alone", problem)
        self._complained = True

    def _read(self) -> int:
        exact, ahead = (_intact(self._file, form, at) for form, at in ((_EXACT, 0), (_AHEAD, _AHEAD_AT)))
        if exact is not None and self._life and exact[1] == self._life:
            return int(exact[0])
        if ahead is not None:
            return int(ahead[0])
        if os.fstat(self._file).st_size:
            _log.warning("%s is damaged; recordings are refused by the clock alone", self._path)
        return 0


def _intact(file: int, form: struct.Struct, at: int) -> tuple[Any, ...] | None:
    """A record; None: it is not there, or damaged."""
    data = os.pread(file, form.size + _CHECK.size, at)
    record = data[: form.size]
    whole = len(data) == form.size + _CHECK.size and data[form.size :] == _CHECK.pack(crc32(record))
    return form.unpack(record) if whole else None


def _life() -> bytes:
    """Name this life of the machine; empty: its system does not say."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_bytes().strip()[:36]
    except OSError:
        return b""
