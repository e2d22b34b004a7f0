"""Textual's driver, for terminals that vanish: what is drawn then is drawn nowhere.

Textual writes in a thread and hands texts over in a bounded queue. An error in that thread, such as that of a
terminal that was closed, ends it; then the queue fills up, and the event loop waits at it for ever, deaf to
every signal (Textual 8.2.8, `textual/drivers/_writer_thread.py`).
"""

from __future__ import annotations

import logging
from codecs import IncrementalDecoder, getincrementaldecoder
from collections.abc import Callable, Iterable
from functools import partial
from typing import IO, Any, Final, cast

from textual._xterm_parser import XTermParser
from textual.driver import Driver
from textual.drivers import linux_driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from robotree.tui.screen.key_guard import KeysInOrder
from robotree.tui.terminal import forget_the_reader

log = logging.getLogger(__name__)

LONGEST: Final = 100_000
"""[characters] of one paste that are kept: no field takes as many."""
BEGIN, END = "\x1b[200~", "\x1b[201~"
"""What a terminal sends around a paste (xterm, bracketed paste mode)."""


STOP = "\x13"
"""What a terminal sends for ctrl+s, the key that stops robots anywhere."""


def forgiving_decoder(encoding: str) -> Callable[[], IncrementalDecoder]:
    """Return how to make a decoder for which no byte is an error: noise must not end the screen."""
    return partial(getincrementaldecoder(encoding), errors="replace")


class BoundedPaste(XTermParser):
    """Textual's reader of what a terminal sends, with pastes that have a largest size.

    A terminal says where a paste begins and where it ends. Textual gathers what comes between (8.2.8,
    `XTermParser.parse`), so one whose end never comes, from a broken terminal or of a file that somebody
    pipes into one, would fill the memory. What is beyond `LONGEST` is left out here, and what comes behind
    the end are keys again.
    """

    _room: int | None = None
    """Characters that the paste may still have; None: nothing is being pasted."""
    _last = ""
    """End of what was read: it may hold the first characters of `BEGIN`, or, in a paste, of `END`."""

    def feed(self, data: str) -> Iterable[Message]:
        """Read on; `data` is empty at the end.

        The stop, in a read of its own, is no part of a paste: it ends one that the terminal has not ended.
        """
        if self._room is not None and set(data) == {STOP}:
            data = END + data
        kept = self._bounded(data)
        return super().feed(kept) if kept or not data else ()

    def _bounded(self, data: str) -> str:
        kept = ""
        while data:
            if self._room is None:
                seen = self._last + data
                at = seen.find(BEGIN)
                cut = len(data) if at < 0 else at + len(BEGIN) - len(self._last)
                self._last = seen[1 - len(BEGIN) :] if at < 0 else ""
                self._room = None if at < 0 else LONGEST
                kept, data = kept + data[:cut], data[cut:]
                continue
            inside, end, data = (self._last + data).partition(END)
            begun = 0 if end else next((n for n in range(len(END) - 1, 0, -1) if inside.endswith(END[:n])), 0)
            self._last = inside[len(inside) - begun :]
            inside = inside[: len(inside) - begun]
            if len(inside) > self._room > 0:
                log.warning("a paste has more than %d characters: the rest is left out", LONGEST)
            kept += inside[: self._room] + end
            self._room = None if end else max(self._room - len(inside), 0)
        return kept


class Outliving:
    """A standard stream whose writing never fails."""

    def __init__(self, stream: IO[str]) -> None:
        """Write to `stream` as long as somebody can read it."""
        self._stream = stream

    def write(self, text: str) -> None:
        """Write, or do not."""
        try:
            self._stream.write(text)
        except OSError:
            forget_the_reader(self._stream)

    def flush(self) -> None:
        """Have it written, or not."""
        try:
            self._stream.flush()
        except OSError:
            forget_the_reader(self._stream)

    def fileno(self) -> int:
        """Return the stream's file descriptor."""
        return self._stream.fileno()


LEAVE = "\x1b[?1049l"
"""What leaves the alternate screen (xterm), so that the shell shows again."""


class OutlivingDriver(LinuxDriver):
    """Goes on when its terminal has gone. What ends the program then is `processes.ending`."""

    stays = False
    """Whether the alternate screen is not left at the end, because another program is drawn over this one."""

    def run_input_thread(self) -> None:
        """Read the terminal, with pastes that have a largest size, and whatever bytes it sends."""
        setattr(linux_driver, "XTermParser", BoundedPaste)  # noqa: B010 # Textual makes those of its module
        setattr(linux_driver, "getincrementaldecoder", forgiving_decoder)  # noqa: B010
        super().run_input_thread()

    def send_message(self, message: Message) -> None:
        """Send what came from the terminal, unless too much waits (`KeysInOrder.admits`)."""
        if not isinstance(self._app, KeysInOrder) or self._app.admits(message):
            super().send_message(message)

    def write(self, data: str) -> None:
        """Write to the terminal."""
        if not (self.stays and data == LEAVE):
            super().write(data)

    def __init__(self, *given: Any, **named: Any) -> None:
        """Take what Textual gives."""
        super().__init__(*given, **named)  # pyright: ignore[reportUnknownMemberType] # Textual leaves it open
        self._file = cast("Any", Outliving(cast("IO[str]", self._file)))


def outliving(chosen: type[Driver]) -> type[Driver]:
    """Return the driver to be used where Textual has chosen this one."""
    return OutlivingDriver if chosen is LinuxDriver else chosen
