"""MAVLink FTP, read-only: a few small files that a component has in memory.

Each client has one session, number 0, with the file that it opened last: MAVSDK 4.1 ignores which number it
is given. Sessions that nobody ends are forgotten when there are more than `CLIENTS`
(https://mavlink.io/en/services/ftp.html).

Pure.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from enum import IntEnum
from struct import Struct
from typing import Final

from robotree.protocol.messages import AnyMessage, fields_of, make
from robotree.protocol.services.peer import Peer

MESSAGE: Final = "FILE_TRANSFER_PROTOCOL"
CLIENTS: Final = 32
"""Files that are open at a time; the one opened first is closed for a further one."""
BURST: Final = 8
"""Messages of one burst, 2 kB; then the client asks on. So telemetry is not held up on a slow line."""
_HEADER: Final = Struct("<HBBBBBxI")
"""Of the payload: sequence, session, opcode, size, the opcode that is answered, end of a burst, padding,
offset; then come the data."""
_PAYLOAD: Final = 251
DATA: Final = _PAYLOAD - _HEADER.size
"""[bytes] of a file in one message."""
_WORD: Final = 0xFFFF


class Opcode(IntEnum):
    """MAV_FTP_OPCODE."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """MAV_FTP_ERR, as far as we need it."""

    INVALID_SESSION = 4
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


_NOTHING_TO_DO: Final = {Opcode.NONE, Opcode.TERMINATE_SESSION, Opcode.RESET_SESSIONS}
_READS: Final = {Opcode.READ_FILE, Opcode.BURST_READ_FILE}
_CHANGES: Final = {*range(Opcode.CREATE_FILE, Opcode.CALC_FILE_CRC32)}


class Refused(Exception):
    """A request is answered by NAK."""

    def __init__(self, error: FtpError) -> None:
        super().__init__(error.name)
        self.error = error


def crc32(data: bytes) -> int:
    """The CRC32 of MAVLink's files: that of zlib, but begun with 0 and not inverted at the end.

    >>> hex(crc32(b"123456789"))
    '0x2dfd2d88'
    """
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


class Files:
    """The files of one component.

    Args:
        content: by name, without a folder; at most 255.
    """

    def __init__(self, content: Mapping[str, bytes]) -> None:
        self._content = dict(content)
        self._names = list(content)
        self._open: dict[Peer, str] = {}

    def answer(self, question: AnyMessage, asker: Peer) -> list[AnyMessage]:
        """Answer a FILE_TRANSFER_PROTOCOL; an answer gets none."""
        payload = fields_of(question)["payload"]
        assert isinstance(payload, bytes)  # noqa: S101  an array of uint8_t
        sequence, session, opcode, size, _, _, offset = _HEADER.unpack_from(payload)
        data = payload[_HEADER.size :][: min(size, DATA)]
        if opcode in {Opcode.ACK, Opcode.NAK}:
            return []
        answers: list[tuple[Opcode, int, bytes]]
        try:
            parts = list(self._parts(asker, session, opcode, size, offset, data))
            answers = [(Opcode.ACK, *part) for part in parts]
            session = 0 if opcode == Opcode.OPEN_FILE_RO else session
        except Refused as refused:
            answers = [(Opcode.NAK, offset, bytes((refused.error,)))]
        return [
            self._said(asker, sequence + number, (session, opcode), one, last=number == len(answers))
            for number, one in enumerate(answers, 1)
        ]

    def _parts(
        self, asker: Peer, session: int, opcode: int, size: int, offset: int, data: bytes
    ) -> Iterator[tuple[int, bytes]]:
        """Offset and data of each answer.

        Raises:
            Refused: there is none.
        """
        if opcode in _NOTHING_TO_DO:
            if opcode != Opcode.NONE:
                self._open.pop(asker, None)
            yield offset, b""
        elif opcode == Opcode.LIST_DIRECTORY:
            yield offset, self._listed(_path(data), offset)
        elif opcode == Opcode.OPEN_FILE_RO:
            content = self._content_of(_path(data))
            self._open.pop(asker, None)
            if len(self._open) == CLIENTS:
                self._open.pop(next(iter(self._open)))
            self._open[asker] = _path(data)
            yield 0, len(content).to_bytes(4, "little")
        elif opcode == Opcode.CALC_FILE_CRC32:
            yield 0, crc32(self._content_of(_path(data))).to_bytes(4, "little")
        elif opcode in _READS:
            if session or asker not in self._open:
                raise Refused(FtpError.INVALID_SESSION)
            yield from _read(self._content_of(self._open[asker]), opcode, size, offset)
        else:
            raise Refused(FtpError.FILE_PROTECTED if opcode in _CHANGES else FtpError.UNKNOWN_COMMAND)

    def _listed(self, folder: str, first: int) -> bytes:
        if folder not in {"", "."}:
            raise Refused(FtpError.FILE_NOT_FOUND)
        listing = b""
        for name in self._names[first:]:
            entry = f"F{name}\t{len(self._content[name])}\0".encode()
            if len(listing + entry) > DATA:
                break
            listing += entry
        if not listing:
            raise Refused(FtpError.END_OF_FILE)
        return listing

    def _content_of(self, path: str) -> bytes:
        if path not in self._content:
            raise Refused(FtpError.FILE_NOT_FOUND)
        return self._content[path]

    @staticmethod
    def _said(
        asker: Peer, sequence: int, asked: tuple[int, int], answer: tuple[Opcode, int, bytes], *, last: bool
    ) -> AnyMessage:
        (session, opcode), (code, offset, data) = asked, answer
        ends = int(last and code is Opcode.ACK and opcode == Opcode.BURST_READ_FILE)
        head = _HEADER.pack(sequence & _WORD, session, code, len(data), opcode, ends, offset)
        target = {"target_system": asker.system, "target_component": asker.component}
        return make(MESSAGE, target_network=0, **target, payload=(head + data).ljust(_PAYLOAD, b"\0"))


def _read(content: bytes, opcode: int, size: int, offset: int) -> Iterator[tuple[int, bytes]]:
    """One part of a file, or several in a burst."""
    step, count = (DATA, BURST) if opcode == Opcode.BURST_READ_FILE else (min(size, DATA), 1)
    if offset >= len(content) or not step:
        raise Refused(FtpError.END_OF_FILE)
    for at in range(offset, min(len(content), offset + count * step), step):
        yield at, content[at:][:step]


def _path(data: bytes) -> str:
    return data.partition(b"\0")[0].decode(errors="replace").lstrip("/")
