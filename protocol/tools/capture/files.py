"""Recordings in files, read piece by piece; `-` is standard input, which may be a live pipe."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, cast

from robotree.protocol.tools.capture.decode import HEAD_BYTES, READERS, Decoder, detect
from robotree.protocol.tools.capture.records import BadRecording

if TYPE_CHECKING:
    from collections.abc import Generator
    from io import BufferedReader

    from robotree.protocol.tools.capture.decode import Decoded, DecoderStatistics, Reader
    from robotree.protocol.tools.capture.records import Captured

PIECE = 64 * 1024
"""[bytes]"""
STANDARD_INPUT = "-"


def pieces(name: str) -> Generator[bytes]:
    """The bytes of a file, as they come.

    Yields:
        At most PIECE bytes.

    Raises:
        BadRecording: the file cannot be read.
    """
    try:
        with ExitStack() as stack:
            source = (
                sys.stdin.buffer if name == STANDARD_INPUT else stack.enter_context(Path(name).open("rb"))
            )
            while piece := cast("BufferedReader", source).read1(PIECE):
                yield piece
    except OSError as error:
        raise BadRecording(name, f"cannot be read: {error.strerror or error}") from error


class Recording:
    """One file, to be gone through once.

    Args:
        name: of the file; `-`: standard input.
        form: its format, one of `READERS`; empty: it is detected.

    Raises:
        BadRecording: there is no such format, or the file cannot be read.
    """

    def __init__(self, name: str, form: str = "") -> None:
        if form and form not in READERS:
            raise BadRecording(name, f"{form!r} is no format; there is {', '.join(READERS)}")
        self.name = "standard input" if name == STANDARD_INPUT else name
        self._pieces = pieces(name)
        self._head = b""
        while len(self._head) < HEAD_BYTES and (piece := next(self._pieces, b"")):
            self._head += piece
        self.form = form or detect(self._head, name)
        self._reader: Reader = READERS[self.form]()
        self._decoder = Decoder(self.form, self._reader)

    @property
    def statistics(self) -> DecoderStatistics:
        """The statistics of the frames that were decoded so far."""
        return self._decoder.statistics

    def frames(self) -> Generator[list[Decoded]]:
        """All frames, in the batches in which they come.

        Yields:
            The frames of one piece of the file.
        """
        yield self._decoder.feed(self._head)
        for piece in self._pieces:
            yield self._decoder.feed(piece)
        yield self._decoder.flush()

    def captured(self) -> Generator[Captured]:
        """The captured frames, undecoded: also of messages that the dialect does not have.

        Yields:
            One frame, or a piece of a stream that was recorded without times.
        """
        yield from self._reader.feed(self._head)
        for piece in self._pieces:
            yield from self._reader.feed(piece)
        yield from self._reader.flush()
