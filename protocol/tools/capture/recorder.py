"""From what a link hears to a recording. The stream that it writes to, and the time, are handed in."""

from __future__ import annotations

from typing import TYPE_CHECKING, BinaryIO, Protocol

from robotree.protocol.tools.capture.framing import Splitter
from robotree.protocol.tools.capture.mcap import McapWriter
from robotree.protocol.tools.capture.records import BadRecording
from robotree.protocol.tools.capture.replay import carries_secret
from robotree.protocol.tools.capture.tlog import TlogWriter

if TYPE_CHECKING:
    from collections.abc import Callable


class Writer(Protocol):
    """Writes one format."""

    def write(self, time: int, frame: bytes) -> None:
        """Append one whole frame that came at `time`, [us] since 1970."""
        ...

    def flush(self) -> None:
        """Hand all that was written to the stream, so that it can be read; call it about once a second."""
        ...

    def close(self) -> None:
        """Write what belongs to the end; the stream stays open."""
        ...


WRITERS: dict[str, Callable[[BinaryIO], Writer]] = {".tlog": TlogWriter, ".mcap": McapWriter}
"""Every format that is written, by the suffix of its files."""


def writer_of(name: str) -> Callable[[BinaryIO], Writer]:
    """The writer for the suffix of a file's name.

    Raises:
        BadRecording: there is no format of this suffix.
    """
    for suffix, make in WRITERS.items():
        if name.endswith(suffix):
            return make
    raise BadRecording(name, f"its name must end with {' or '.join(WRITERS)}, which names the format")


class Recorder:
    """Writes the frames of one link; what is no frame, or carries a secret, is counted.

    Args:
        writer: writes the format.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._splitter = Splitter()
        self.frames = 0
        self.skipped = 0
        """[bytes] that are no frame."""
        self.withheld = 0
        """Frames that were left out because they carry a secret."""

    def take(self, data: bytes, now: float) -> None:
        """Take some bytes that came at `now`, [s] since 1970."""
        time = round(now * 1e6)
        for piece in self._splitter.feed(data):
            if piece.framed and carries_secret(piece.data):
                self.withheld += 1
            elif piece.framed:
                self._writer.write(time, piece.data)
                self.frames += 1
            else:
                self.skipped += len(piece.data)

    def flush(self) -> None:
        """Hand what was recorded to the stream; who is killed afterwards leaves a file that can be read."""
        self._writer.flush()

    def close(self) -> None:
        """The link ended."""
        self.skipped += sum(len(piece.data) for piece in self._splitter.flush())
        self._writer.close()
